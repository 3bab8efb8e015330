"""What the page says: complete in both languages, and nothing that no script asks for."""

import ast
import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from adapters.reading import Fault
from estimator.diagnosis.finding import FINDINGS, FOR_EXPERTS
from replay.reports.language import sayer as spoken_by_reports
from service.publish.language import Say
from service.publish.language import sayer as spoken_by_all
from service.records.status import STATES

STATIC = Path(__file__).parents[3] / "service" / "web" / "static"
LANGUAGES = {name: json.loads((STATIC / f"text-{name}.json").read_text(encoding="utf-8")) for name in ("en", "de")}
SCRIPTS = "\n".join(path.read_text(encoding="utf-8") for path in STATIC.glob("*.js"))


ROOT = STATIC.parents[2]
SAID = json.loads((STATIC / "said-de.json").read_text(encoding="utf-8"))
REPORTED = json.loads((ROOT / "replay" / "reports" / "report-de.json").read_text(encoding="utf-8"))
GAP = re.compile(r"\{\{|\}\}|\{(\w+)\}")

SPOKEN = json.loads(Path(__file__).with_name("spoken.json").read_text(encoding="utf-8"))
"""Where the sentences stand that the page and the report show, and in which functions of these files."""


def spoken(path: str, functions: tuple[str, ...] | None) -> Iterator[str]:
    """The sentences of four words and more in a file, with 7 for whatever is filled in."""
    if path.endswith(".md"):
        yield from written(path)
        return
    tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    silent = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    silent |= {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values}
    named = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and node.name in (functions or ())]
    for node in (inner for place in ([tree] if functions is None else named) for inner in ast.walk(place)):
        text = ""
        if isinstance(node, ast.JoinedStr):
            text = "".join(str(part.value) if isinstance(part, ast.Constant) else "7" for part in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in silent:
            text = node.value
        # What begins with a comma or a space is only a part of a sentence.
        if len(re.findall(r"[A-Za-z]{2,}", text)) >= 4 and text[0] not in ", ":
            yield text


def written(path: str) -> Iterator[str]:
    """The same of the words of a report."""
    # What is said of thinned lines is a part of another text.
    text = (ROOT / path).read_text(encoding="utf-8").replace("{thinned}", " One sample in {every} is drawn.")
    text = text.replace("## Thinned\n\nOne sample in {every} is drawn.\n\n", "")
    for block in re.sub(r"^#+ |\[\[.*?\]\] ", "", text, flags=re.M).split("\n\n"):
        head, *below = block.split("\n")
        # A title and its note are two texts, the lines of a paragraph one.
        texts = [head, " ".join(below)] if len(head) < 100 else [" ".join([head, *below])]
        yield from (GAP.sub("7", text) for text in texts if len(re.findall(r"[A-Za-z]{2,}", text)) >= 4)


@pytest.mark.parametrize("path", SPOKEN)
def test_every_sentence_of_the_daemon_and_the_report_is_there_in_german(path: str) -> None:
    said = list(spoken(path, SPOKEN[path]))
    assert said, "the search finds them"
    # What the daemon says is on the page as well, which does not know what only reports say.
    german = spoken_by_reports("de") if path.startswith("replay") else spoken_by_all("de")
    assert [text for text in said if german(text) == text] == []


@pytest.mark.parametrize("sayer", [spoken_by_all, spoken_by_reports])
def test_why_a_saving_is_not_known_is_german_also_at_the_end_of_a_sentence(sayer: Callable[[str], Say]) -> None:
    english = "What 1 K less would have saved is not known, for the heat loss is not"
    german = "Was 1 K weniger gespart hätte, ist nicht bekannt, denn der Wärmeverlust ist es nicht"
    assert sayer("de")(english) == german
    assert spoken_by_reports("de")(f"{english}.") == f"{german}."


def test_sentences_have_the_same_gaps_in_both_languages() -> None:
    for english, german in (SAID | REPORTED).items():
        gaps = [sorted(gap[0] for gap in GAP.finditer(text)) for text in (english, german)]
        assert gaps[0] == gaps[1], english


def test_what_to_do_and_why_are_there_one_without_the_other() -> None:
    assert [english for english in SAID if "; " in english] == []


def test_both_languages_have_the_same_texts_with_the_same_gaps() -> None:
    english, german = LANGUAGES["en"], LANGUAGES["de"]
    assert list(english) == list(german)
    for key, text in english.items():
        assert sorted(re.findall(r"\{(\w+)\}", text)) == sorted(re.findall(r"\{(\w+)\}", german[key])), key
        assert text.strip(), key
        assert german[key].strip(), key


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_text_that_a_script_asks_for_is_there(language: str) -> None:
    asked = set(re.findall(r'\bt\("([^"]+)"', SCRIPTS)) | set(re.findall(r'\bt\(\w+ \? "([^"]+)"', SCRIPTS))
    assert len(asked) > 80
    assert asked <= LANGUAGES[language].keys()
    assert {f"state.{state}" for state in STATES} <= LANGUAGES[language].keys()
    assert {f"fault.{fault}" for fault in Fault} <= LANGUAGES[language].keys()
    assert {f"finding.{finding}" for finding in FINDINGS} <= LANGUAGES[language].keys()


def test_no_text_is_left_over() -> None:
    """Every text is asked for by its name, or belongs to a family that a script puts together."""
    families = {match.split("${")[0] for match in re.findall(r"\b(?:t|tell)\(`([^`]+)`", SCRIPTS)}
    named = set(re.findall(r'"([a-z_]+(?:\.[a-z_-]+)*)"', SCRIPTS))
    for key in LANGUAGES["en"]:
        assert key in named or any(key.startswith(family) for family in families), key


@pytest.mark.parametrize(
    "path", ["service/web/static/ranking.js", "deploy/home-assistant/custom_components/thermogate/coordinator.py"]
)
def test_what_is_for_experts_is_so_on_the_page_and_in_home_assistant(path):
    listed = re.search(r"FOR_EXPERTS = [^\[{]*[\[{](.*?)[\]}]", (ROOT / path).read_text(encoding="utf-8"), re.DOTALL)
    assert sorted(re.findall(r'"([a-z-]+)"', listed[1])) == sorted(FOR_EXPERTS)
