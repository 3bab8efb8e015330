"""What the page says: complete in both languages, and nothing that no script asks for."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from estimator.diagnosis.finding import FINDINGS
from service.records.status import STATES

STATIC = Path(__file__).parents[3] / "service" / "web" / "static"
LANGUAGES = {name: json.loads((STATIC / f"text-{name}.json").read_text(encoding="utf-8")) for name in ("en", "de")}
SCRIPTS = "\n".join(path.read_text(encoding="utf-8") for path in STATIC.glob("*.js"))


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
    assert {f"finding.{finding}" for finding in FINDINGS} <= LANGUAGES[language].keys()


def test_no_text_is_left_over() -> None:
    """Every text is asked for by its name, or belongs to a family that a script puts together."""
    families = {match.split("${")[0] for match in re.findall(r"\b(?:t|tell)\(`([^`]+)`", SCRIPTS)}
    named = set(re.findall(r'"([a-z_]+(?:\.[a-z_-]+)*)"', SCRIPTS))
    for key in LANGUAGES["en"]:
        assert key in named or any(key.startswith(family) for family in families), key
