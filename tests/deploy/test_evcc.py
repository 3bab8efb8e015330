"""What the documentation tells evcc: the commands of the page, between a room and evcc's documented API."""

import os
import shutil
import subprocess
from collections.abc import Iterator

import pytest
from support.harness import ROOT
from support.http_client import get
from support.site_of_rooms import Room, site_of
from support.web_answers import answering

pytestmark = pytest.mark.skipif(not (shutil.which("curl") and shutil.which("jq")), reason="curl or jq is missing")


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, list[str]]]:
    """Where both are: a site of Thermogate, in which "living" has learned, and an evcc that notes what it is told."""
    told: list[str] = []
    rooms = {"living": Room("ekf", "tite", samples=576, told=True), "new": Room(samples=0)}
    with site_of(tmp_path_factory.mktemp("site"), rooms) as (app, _):

        def answer(path: str, _: str | None) -> tuple[int, bytes]:
            if path.startswith("/zones"):
                found = get(app, path)
                return found.status_code, found.content
            told.append(path)
            return 200, b""

        with answering(answer) as place:
            yield place, told


def commands() -> str:
    page = (ROOT / "docs" / "control.md").read_text(encoding="utf-8")
    return page.partition("## evcc")[2].partition("```console\n")[2].partition("```")[0]


def run(words: str, place: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"THERMOGATE": place, "EVCC": place}
    return subprocess.run(["sh", "-c", words], env=environment, capture_output=True, text=True, timeout=60, check=False)


def test_evcc_is_told_the_electricity_and_the_time(served: tuple[str, list[str]]) -> None:
    place, told = served
    done = run(commands().replace("target=21", "target=20.5"), place)
    assert done.returncode == 0, done.stderr
    asked = f"{place}/zones/living/preheat?target=20.5&by=06:30"
    known = subprocess.run(["curl", "-fsS", asked], capture_output=True, check=True, text=True).stdout
    path, energy, by = told.pop().rsplit("/", 2)
    assert path == "/api/loadpoints/1/plan/energy"
    kwh = subprocess.run(["jq", ".energy.mean"], input=known, capture_output=True, check=True, text=True).stdout
    assert float(energy) == pytest.approx(float(kwh) / 3.5, abs=0.006)
    assert by == "1970-01-03T06:30:00Z"


def test_evcc_is_told_nothing_of_a_room_that_does_not_know(served: tuple[str, list[str]]) -> None:
    place, told = served
    assert run(commands().replace("zones/living", "zones/new"), place).returncode != 0
    assert not told
