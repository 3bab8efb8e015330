"""Everything that leaves the project, as it left it before: see tests/support/golden.py for how the files are made."""

import asyncio
import io
import json
import re
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, Self

import httpx
import numpy as np
import pandas as pd
import pytest
from fastapi import FastAPI
from prometheus_client import generate_latest
from support import golden
from support.fake_zones import broken, doubted
from support.golden_site import SAMPLES, SITE, GoldenSite, learned, written
from support.http_client import scope
from support.running_zone import Announced
from support.tables import tabled

import thermogate as tg
from adapters.reading import Fault
from estimator.types import ALPHA_LEVELS
from replay.recorded.runner import replay_recording
from service.config.load import load
from service.errors import ReloadRefused
from service.forecast.ahead import LookingAhead
from service.forecast.learned import SkillQuestion
from service.publish.events import Streams
from service.publish.home_assistant import discovery
from service.publish.metrics import Metrics
from service.publish.sinks import Announcement, Occasion, Reports
from service.publish.zenoh import Publisher
from service.records.receipt import Receipt
from service.web.app import create_app
from service.web.keys import KeyRing, create_key
from service.web.page import overview
from service.web.site import Backend
from service.zone.zone import Zone

ZONES = ("rbpf", "mkf", "bank", "ekf", "arx", "waiting")
DISCOVERED = ("mkf", "ekf", "waiting")
"""Zones whose entities of Home Assistant are looked at: with a gain, with two outputs, and with nothing."""

ASKED = json.loads(Path(__file__).with_name("asked.json").read_text(encoding="utf-8"))
"""Requests whose answers are kept: method, path, and a body or null."""
ELSEWHERE = {"/openapi.json", "/metrics", "/overview", "/overview/stream", "/zones/{zone}/stream"}
"""Routes that have files of their own."""

Files = Mapping[str, str]


class Asked:
    """The application as its administrator uses it."""

    def __init__(self, app: FastAPI, secret: str) -> None:
        self.app, self.headers = app, {"Authorization": f"Bearer {secret}"}

    async def ask(self, method: str, path: str, body: Any = None, **headers: str) -> httpx.Response:
        transport = httpx.ASGITransport(self.app)
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost", timeout=180) as client:
            return await client.request(method, path, json=body, headers=self.headers | headers)

    async def shown(self, asked: Sequence[tuple[str, str, Any]], prefix: str = "") -> str:
        """Every answer with its status and its kind."""
        parts = []
        for method, path, body in asked:
            answer = await self.ask(method, prefix + path, body)
            given = "" if body is None else f" {json.dumps(body)}"
            kind = answer.headers.get("content-type", "")
            parts.append(
                f"### {method} {prefix}{path}{given}\n{answer.status_code} {kind}\n{golden.lines(answer.text)}"
            )
        return "\n\n".join(parts) + "\n"


class Session:
    """A session of Zenoh that notes what is declared and put."""

    def __init__(self) -> None:
        self.declared: list[str] = []
        self.puts: list[str] = []

    def declare_publisher(self, key: str, **settings: Any) -> Any:
        self.declared.append(f"publisher {key} {settings['encoding']}")
        return _Put(self, key)

    def declare_queryable(self, key: str, handler: Any, *, complete: bool = False) -> Any:
        self.declared.append(f"queryable {key} {'complete' if complete else ''}".rstrip())
        return self

    def liveliness(self) -> Self:
        return self

    def declare_token(self, key: str) -> Self:
        self.declared.append(f"token {key}")
        return self


class _Put:
    def __init__(self, session: Session, key: str) -> None:
        self._session, self._key = session, key

    def put(self, payload: bytes) -> None:
        self._session.puts.append(f"### {self._key}\n{golden.lines(payload.decode())}")


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Files:
    """Everything by the name of its file."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(overview, "PAUSE", 0.01)
        found = asyncio.run(_gathered(tmp_path_factory.mktemp("golden")))
    return found | _replayed(tmp_path_factory.mktemp("replayed")) | _fitted(tmp_path_factory.mktemp("fitted"))


async def _gathered(folder: Path) -> dict[str, str]:
    found: dict[str, str] = {}
    async with learned(folder) as site:
        announced = {zone.id: await _announcement(zone, site.zones) for zone in site.zones.values()}
        async with _application(site, folder / "keys.json") as (asked, streams):
            for zone in ZONES:
                found[f"rest-{zone}.txt"] = await asked.shown(ASKED["of_a_zone"], f"/zones/{zone}")
            found["model-npz.txt"] = _arrays(
                await asked.ask("GET", "/zones/mkf/model?draws=2", Accept="application/x-npz")
            )
            found["rest-site.txt"] = await asked.shown(ASKED["of_the_site"])
            found["openapi.json"] = golden.lines((await asked.ask("GET", "/openapi.json")).text)
            for announcement in announced.values():
                streams.publish(announcement)
            found["overview.txt"] = await _overview(asked, streams)
            last = "2026-01-02T03:10:00Z"
            found["events.txt"] = "".join(
                [(await asked.ask("GET", f"/zones/{zone}/stream", **{"Last-Event-ID": last})).text for zone in ZONES]
            )
        found["topics.txt"] = _topics(announced)
        found["events.txt"] = golden.lines(found["events.txt"])
        found["metrics.txt"] = _metrics(site, announced)
    found["rest-findings.txt"] = await _findings()
    return found


@asynccontextmanager
async def _application(site: GoldenSite, keys: Path) -> AsyncIterator[tuple[Asked, Streams]]:
    answers = [ReloadRefused(["zones[0] ('rbpf').period: must be 10min"]), "1 zone changed: rbpf"]

    async def reload() -> str:
        answer = answers.pop()
        if isinstance(answer, ReloadRefused):
            raise answer
        return answer

    async def take(posted: Sequence[Any], zone: str | None) -> Receipt:
        return Receipt(3, 2, 4, Counter({Fault.OUT_OF_RANGE: 1}), 1, ("office/CO2",))

    secret, streams = create_key(keys, "boss", "admin"), Streams()
    app = create_app(
        SITE,
        site.zones,
        site.metrics.registry,
        keys=KeyRing(keys, required=False),
        backend=Backend("1.2.3", "Europe/Berlin", reload=reload, take=take, streams=streams),
    )
    documented = set(app.openapi()["paths"])
    paths = {group: [path.partition("?")[0] for _, path, _ in asked] for group, asked in ASKED.items()}
    asked_for = {re.sub("^/zones/[^/]+", "/zones/{zone}", path) for path in paths["of_the_site"]}
    asked_for |= {"/zones/{zone}" + path for path in paths["of_a_zone"]}
    assert documented > ELSEWHERE - {"/openapi.json"}
    assert documented <= asked_for | ELSEWHERE, "every route has a golden answer"
    yield Asked(app, secret), streams


async def _overview(asked: Asked, streams: Streams) -> str:
    """The overview once the next hours and the last day of every zone that has them are known, and an event of it."""
    sent: list[str] = []
    listening = asyncio.create_task(_streamed(asked, "/overview/stream", sent))
    async with asyncio.timeout(180):
        while True:
            answer = await asked.ask("GET", "/overview")
            rows = answer.json()["zones"]
            if all(row["spark"] and (row["expected"] or row["state"] != "running") for row in rows):
                break
            streams.note(rows[0]["id"])
            await asyncio.sleep(0.05)
        # What was on its way is behind this event: it has the row of one zone, and nothing new of it.
        await asyncio.sleep(0.3)
        sent.clear()
        streams.note("rbpf")
        streams.note("gone")
        while "gone" not in "".join(sent):
            await asyncio.sleep(0.01)
    streams.end()
    await listening
    return golden.lines(answer.text) + "\n\n" + golden.lines(next(one for one in sent if "gone" in one))


async def _streamed(asked: Asked, path: str, sent: list[str]) -> None:
    """The body of an answer that goes on, part by part."""
    never: asyncio.Future[Any] = asyncio.get_running_loop().create_future()

    async def send(message: Any) -> None:
        sent.append(message.get("body", b"").decode())

    receive: Callable[[], Awaitable[Any]] = lambda: never  # noqa: E731
    await asked.app(scope("GET", path, asked.headers), receive, send)


def _arrays(answer: httpx.Response) -> str:
    """The names and the form of the arrays of a model as npz, and what is told about them."""
    with np.load(io.BytesIO(answer.content)) as arrays:
        shown = [f"{name} {array.dtype.kind} {array.shape}" for name, array in arrays.items()]
        return "\n".join([*shown, golden.lines(str(arrays["about"]))]) + "\n"


async def _announcement(zone: Zone, zones: Mapping[str, Zone]) -> Announcement:
    """What `zone` tells when everything about it is news."""
    heat_loss = zone.worker.heat_loss(ALPHA_LEVELS)
    heard = Announced()
    await LookingAhead(SITE, zones, [heard]).attend(zone.id)
    ahead = next((one.reports.ahead for one in heard.told if one.zone == zone.id), None)
    reports = Reports(await zone.ask(SkillQuestion()), heat_loss, zone.now().trust, ahead)
    return Announcement(SITE, zone.id, zone.now(), Occasion.UPDATE, reports)


def _topics(announced: Mapping[str, Announcement]) -> str:
    """What every sink passes on: the keys of Zenoh with their values, and the topics of MQTT, Home Assistant's too."""
    session = Session()
    publisher = Publisher(session, SITE)  # type: ignore[arg-type]
    publisher.answer_with(lambda question, reply: None)
    messages = {}
    for zone, announcement in announced.items():
        publisher.add(zone)
        publisher.publish(announcement)
        if zone in DISCOVERED:
            base, available = f"thermogate/{SITE}/{zone}", f"thermogate/{SITE}/availability"
            messages |= discovery("homeassistant", SITE, base, available, announcement)
    shown = [f"### {topic}\n{golden.lines(message.decode())}" for topic, message in messages.items()]
    return "\n".join([*session.declared, *session.puts, *shown]) + "\n"


def _metrics(site: GoldenSite, announced: Mapping[str, Announcement]) -> str:
    """The metrics of the last announcement, without those that count seconds of this machine."""
    metrics = Metrics(site.zones, "1.2.3")
    for announcement in announced.values():
        metrics.add(announcement.zone)
        metrics.publish(announcement)
    own = re.compile(r"^(# (HELP|TYPE) )?(process_|python_|thermogate_(update_seconds|build_info|.*delay|event_loop))")
    shown = [line for line in generate_latest(metrics.registry).decode().splitlines() if not own.match(line)]
    return "\n".join(line for line in shown if "_created" not in line) + "\n"


async def _findings() -> str:
    """Zones that are all well, a model of which not everything is known, and a history that cannot be read."""
    zones = {zone.id: zone for zone in (doubted("living"), broken("cellar"))}
    asked = Asked(create_app(SITE, zones, Metrics(zones).registry), "")
    paths = ["/zones/living", "/zones/living/parameters", "/overview", "/readyz"]
    paths += ["/zones/cellar/history", "/zones/cellar/skill"]
    return await asked.shown([("GET", path, None) for path in paths])


def _replayed(folder: Path) -> dict[str, str]:
    """The files of a replay."""
    config = load(written(folder))
    end = 1_767_225_600 + 600 * 25
    config = config.model_copy(update={"zones": config.zones[:4]})
    replay_recording(config, folder / "out", end=end, progress=False)
    found = {
        f"replay-{zone.id}-{name}": (folder / "out" / zone.id / name).read_text()
        for zone in config.zones
        for name in ("updates.csv", "parameters.csv")
    }
    return found | {"replay-summary.json": (folder / "out" / "summary.json").read_text()}


def _fitted(folder: Path) -> dict[str, str]:
    """The tables of a notebook."""
    written(folder)
    table = pd.read_csv(folder / "recording.csv", index_col="time", parse_dates=True).iloc[: SAMPLES // 2]
    model = tg.fit(
        pd.DataFrame({"T_i": table["east"].clip(-20, 50), "T_out": table["outside"], "u_heat": table["heat"] * 1000}),
        "titeth",
        estimator="mkf",
        estimator_options={"particles": 30, "scenarios": 40},
        seed=8,
        progress=False,
    )
    tables = {
        "predictions": model.predictions.tail(3),
        "volatility": model.volatility.tail(3),
        "gate": model.gate.tail(3),
        "parameter_history": model.parameter_history.tail(3),
        "disturbance": model.disturbance.tail(3),
        "parameters": model.parameters(),
        "time_constants": model.time_constants(),
        "heat_loss": model.heat_loss(),
        "skill": model.skill(),
        "findings": model.findings,
        "weights": model.weights,
        "forecast": model.forecast({"u_heat": 500.0}, horizon="30min", levels=(0.5, 0.95)),
        "scenarios": model.scenarios(horizon="30min", count=2),
    }
    shown = [f"### {name}\n{_csv(frame)}" for name, frame in tables.items()]
    return {"notebook.txt": "\n".join([*shown, f"### repr\n{model!r}\n"])}


def _csv(frame: Any) -> str:
    text = io.StringIO()
    frame.to_csv(text, lineterminator="\n")
    return text.getvalue()


NAMES = [
    *(f"rest-{zone}.txt" for zone in ZONES),
    *(
        "rest-site.txt",
        "rest-findings.txt",
        "model-npz.txt",
        "openapi.json",
        "overview.txt",
        "events.txt",
        "topics.txt",
        "metrics.txt",
    ),
    *(f"replay-{zone}-{name}.csv" for zone in ZONES[:4] for name in ("updates", "parameters")),
    *("replay-summary.json", "notebook.txt"),
]


@pytest.mark.parametrize("name", NAMES)
def test_what_leaves_the_project_is_what_left_it_before(files: Files, name: str) -> None:
    golden.compare(name, files[name])


def test_every_file_has_its_test(files: Files) -> None:
    assert sorted(files) == sorted(NAMES) == sorted(path.name for path in golden.FOLDER.iterdir())


@tabled
def test_only_the_last_digits_of_a_number_may_differ(before: str, now: str, same: bool) -> None:
    assert golden.alike(before, now) is same
