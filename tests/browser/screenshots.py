"""The pictures of the page in the documentation, from what `make run` shows: `make screenshots`.

Starts the living demo on a free port, lets it run for a while, and photographs the overview and a room with the
browser that the tests use. CI runs it into a folder of its own, so that the pictures in the documentation can always be
made again. With --recordings it also photographs the report of a measured room, which anybody can download
(docs/benchmark.md).
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[2]))

from support.browser import browser, drag, eventually
from support.harness import ROOT
from support.living_demo import demo

import thermogate as tg
from replay.lab.experiments.rooms import read_room

PHOTOGRAPHED = (
    # name, path, width, height, colours, language
    ("live", "/", 1280, 420, "light", "en-GB"),
    ("room", "/#/zone/room1", 1280, 1000, "light", "en-GB"),
    ("room-phone", "/#/zone/room2", 390, 900, "dark", "de-DE"),
)


def main() -> int:
    """Photograph, and say where the pictures are."""
    parser = argparse.ArgumentParser(description="Photograph the page of the living demo.")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "images", help="folder of the pictures")
    parser.add_argument("--seconds", type=float, default=60.0, help="how long the demo runs before")
    parser.add_argument("--recordings", type=Path, help="folder with rooms/ou44.csv, for the picture of a report")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    with demo() as living:
        time.sleep(arguments.seconds)
        _photograph(living.url, arguments.out)
    print("\n".join(str(arguments.out / f"{name}.png") for name, *_ in PHOTOGRAPHED))
    if arguments.recordings is not None:
        print(_report(arguments.recordings, arguments.out / "report.png"))
    return 0


def _report(folder: Path, out: Path) -> Path:
    """Photograph the beginning of the report of a room of the university building OU44."""
    recording = read_room("OU44 22-508-1", folder)
    assert recording is not None, f"{folder} holds no recording of OU44"
    series, where = recording.series, recording.whereabouts
    assert where.location is not None
    times = pd.to_datetime(series.times, unit="s", utc=True)
    table = pd.DataFrame(series.inputs, times, columns=list(recording.network.inputs)).assign(T_i=series.outputs[:, 0])
    model = tg.fit(table, tz=where.time_zone, progress=False, **where.location._asdict())
    with tempfile.TemporaryDirectory() as made, browser() as launched:
        report = model.report(Path(made) / "OU44.html")
        page = launched.new_page(viewport={"width": 1280, "height": 900})
        page.goto(report.as_uri())
        page.screenshot(path=out)
    return out


def _photograph(url: str, out: Path) -> None:
    with browser() as launched:
        for name, path, width, height, colours, language in PHOTOGRAPHED:
            context = launched.new_context(
                viewport={"width": width, "height": height}, color_scheme=colours, locale=language
            )
            context.set_default_timeout(180_000)
            page = context.new_page()
            page.goto(url + path)
            _drawn(page, "zone" in path)
            page.screenshot(path=out / f"{name}.png")
            context.close()


def _drawn(page: Any, room: bool) -> None:
    """Wait until everything that belongs on the picture is there."""
    if room:
        eventually(page, "document.querySelectorAll('.js-plotly-plot .scatterlayer').length >= 2")
        eventually(page, "document.querySelector('.sentences li') !== null")
        # Half of the power from the second to the third quarter of the plan, drawn by hand.
        drag(page, ".plan", (0.25, 0.5), (0.75, 0.5))
        eventually(page, "document.querySelectorAll('.plot.fan .scatterlayer .trace').length === 5")
        page.evaluate("window.scrollTo(0, 0)")
    else:
        page.wait_for_selector("tr[data-zone]")
        eventually(page, "[...document.querySelectorAll('.spark-line')].every(path => path.getAttribute('d'))")
        eventually(
            page, "[...document.querySelectorAll('td.cell-later')].every(cell => cell.textContent.includes('°C'))"
        )


if __name__ == "__main__":
    raise SystemExit(main())
