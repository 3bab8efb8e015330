"""docs/simulate-bms.md says what the simulated BMS does: its examples run, its tables are those in force."""

import json
import re
import shlex

from support.bms_plant import Clock, ask, simulation
from support.pages import TEXT, section, tables

from replay.bms.faults import MENU, parse_spec

BASE = "http://127.0.0.1:5021"


def test_the_menu_is_the_one_in_force() -> None:
    shown = [
        [
            f"`{name}`",
            kind.scope,
            kind.value_unit or "none",
            "" if kind.default is None else f"{kind.default:g}",
            kind.meaning,
        ]
        for name, kind in MENU.items()
    ]
    ((_, *rows),) = tables(section("simulate-bms.md", "Faults"))
    assert rows == shown


def test_fault_examples_are_faults_that_the_plant_can_have() -> None:
    plant = simulation(Clock())
    examples = re.findall(r"--fault (\S+)", TEXT["simulate-bms.md"])
    assert len(examples) >= 4
    for text in examples:
        plant.faults.add(parse_spec(text))


def test_control_examples_work_one_after_the_other() -> None:
    lines = [line for line in TEXT["simulate-bms.md"].splitlines() if line.startswith("curl ")]
    assert len(lines) >= 5
    requests = []
    for line in lines:
        words = shlex.split(line)
        method = words[words.index("-X") + 1] if "-X" in words else "GET"
        body = json.loads(words[words.index("-d") + 1]) if "-d" in words else None
        (url,) = (word for word in words if word.startswith(BASE))
        requests.append((method, url.removeprefix(BASE), body))
    answers = ask(simulation(Clock()), *requests)
    assert all(answer.is_success for answer in answers), [answer.text for answer in answers]
