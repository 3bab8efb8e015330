"""The example of a controller: what it plans, when it falls back, and that it works as its page says."""

import socket
import threading
from collections.abc import Iterator
from dataclasses import replace
from types import ModuleType, SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from support.harness import EXAMPLES, Daemon
from support.tables import tabled

EXAMPLE = "mpc"


@pytest.fixture
def mpc(example: ModuleType) -> ModuleType:
    return example


ALL = dict.fromkeys((300, 3600, 21600, 86400), "trusted")
NOBODY = Mock(side_effect=OSError("connection refused"))


def settings(mpc: ModuleType, **changes: Any) -> Any:
    return mpc.Settings("office", power=4000.0, **({"low": 20.0, "high": 23.0} | changes))


def test_the_plan_holds_the_band_and_costs_least_when_energy_is_cheap(mpc: ModuleType, asking: Any) -> None:
    ask, told = asking(ALL), settings(mpc)

    def prices(steps: int) -> list[float]:
        return [0.1 if k % 24 < 12 else 0.5 for k in range(steps)]

    decision = mpc.decide(ask, told, 20.0, False, prices)
    assert decision.by == "plan"
    assert "planned 24 h ahead" in decision.reason
    assert len(decision.plan) == 96
    assert (decision.plan >= -1e-9).all()
    assert (decision.plan <= 4000.0 + 1e-6).all()
    cheap = np.array(prices(96)) < 0.3
    assert decision.plan[cheap].sum() > decision.plan[~cheap].sum()
    # Flat prices need less energy, for nothing is stored ahead.
    flat = mpc.decide(ask, told, 20.0, False)
    assert flat.plan.sum() <= decision.plan.sum() + 1e-6
    assert (np.array(prices(96)) @ flat.plan) >= (np.array(prices(96)) @ decision.plan) - 1e-6


def test_what_it_foresees_is_what_thermogate_forecasts_under_its_plan(mpc: ModuleType, asking: Any) -> None:
    ask, told = asking(ALL), settings(mpc)
    decision = mpc.decide(ask, told, 20.0, False)
    plan = {"office": {"u_heat": {"step": "15min", "values": np.clip(decision.plan, 0.0, 4000.0).tolist()}}}
    body = {"horizon": "24h", "zones": ["office"], "plans": [{"inputs": plan}]}
    output = ask("POST", "/forecasts", body)["plans"][0]["zones"][0]["outputs"][0]
    mean, sd = np.array(output["mean"])[3::3], np.array(output["sd"])[3::3]
    # The example takes the mean over the draws; the fan of an EKF is that of its mean.
    assert (np.abs(decision.temperatures - mean) < sd).all()


def test_it_plans_as_far_as_the_trust_reaches_and_doubt_of_the_next_hour_costs_a_margin(
    mpc: ModuleType, asking: Any
) -> None:
    def decided(disturbed: bool = False, temperature: float = 20.0, **trusts: str) -> Any:
        told = ALL | {int(lead.lstrip("s")): word for lead, word in trusts.items()}
        return mpc.decide(asking(told, disturbed), settings(mpc), temperature, False)

    far = decided(s86400="learning")
    assert (far.by, len(far.plan), "learning: so" in far.reason) == ("plan", 24, True)
    gap = decided(temperature=19.0, s3600="untrusted")
    assert (gap.by, gap.power) == ("thermostat", 4000.0)
    assert "not trusted for an hour (untrusted: so)" in gap.reason
    sure, doubting = decided(), decided(s3600="doubtful")
    assert (doubting.by, "doubtful" in doubting.reason) == ("plan", True)
    assert doubting.plan.sum() > sure.plan.sum()
    # What is doubtful hours ahead can still be corrected. What acts on the room makes the interval wide, and so the
    # margin: it is not counted twice.
    for harmless in (decided(s21600="doubtful"), decided(disturbed=True, s3600="doubtful")):
        assert np.allclose(harmless.plan, sure.plan)


def test_a_plan_stays_inside_the_band_by_what_is_uncertain(mpc: ModuleType, asking: Any) -> None:
    def planned(sure: float, prices: Any = lambda steps: [0.3] * steps) -> Any:
        decision = mpc.decide(asking(ALL), settings(mpc, sure=sure), 20.0, False, prices)
        (now,) = mpc.forecasts(asking(ALL), settings(mpc), [decision.plan])
        return decision, now.sd

    (plain, _), (kept, sd) = planned(0.0), planned(2.0)
    assert plain.temperatures[8:].min() == pytest.approx(20.0, abs=1e-3)
    assert kept.low == pytest.approx(20.0 + 2.0 * sd[0])
    assert kept.temperatures[8:].min() == pytest.approx(kept.low, abs=1e-3)

    def cheap_first(steps: int) -> list[float]:
        return [0.01] * 24 + [1.0] * (steps - 24)

    (bold, _), (careful, sd) = planned(0.0, cheap_first), planned(2.0, cheap_first)
    assert bold.temperatures.max() == pytest.approx(23.0, abs=1e-3)
    # What is uncertain later is left to later plans.
    assert careful.temperatures[4:].max() == pytest.approx(23.0 - 2.0 * sd[12], abs=2e-3)


def test_between_two_plans_the_planned_temperature_is_held(mpc: ModuleType, asking: Any) -> None:
    told = settings(mpc)
    decision = mpc.decide(asking(ALL), told, 20.0, False)
    assert len(decision.path) == 4, "at the beginning, and after each of three periods of five minutes"
    assert decision.path[-1] == pytest.approx(decision.temperatures[0], abs=1e-6)
    decision = decision._replace(power=2000.0, path=np.array([20.0, 20.3, 20.5, 20.6]), low=20.4, per_watt=1e-3)

    def power(time: float, temperature: float) -> Any:
        return mpc.held(told, decision, decision.start + time, temperature)

    assert power(300.0, 20.3) == pytest.approx(2000.0)
    assert power(300.0, 20.2) == pytest.approx(2100.0), "too cold by 0.1 K, which 100 W make up for within a step"
    assert power(450.0, 20.6) == pytest.approx(1800.0), "half-way between 20.3 and 20.5 degC"
    assert power(900.0, 20.5) == 2000.0, "as planned: colder than planned, and warm enough"
    assert (power(900.0, 15.0), power(0.0, 25.0)) == (4000.0, 0.0)
    assert power(-300.0, 19.0) == 2000.0, "measured before the plan was made"


def test_it_goes_on_from_its_last_plan_and_plans_with_what_others_are_known_to_do(mpc: ModuleType, asking: Any) -> None:
    first = mpc.decide(asking(ALL), settings(mpc), 20.0, False)
    asked: list[Any] = []

    def ask(method: str, path: str, body: Any = None) -> Any:
        asked.append(body)
        return asking(ALL)(method, path, body)

    again = mpc.decide(ask, settings(mpc), 20.0, False, before=first.plan)
    # A model that is linear has the same best plan, whatever it is made around.
    assert np.allclose(again.temperatures, first.temperatures, atol=0.05)
    (body,) = (one for one in asked if one is not None)
    assert body["plans"][0]["inputs"]["office"]["u_heat"]["values"] == pytest.approx(first.plan.tolist())

    def cold(steps: int) -> Any:
        return {"office": {"T_out": [-15.0] * steps}}

    assert mpc.decide(asking(ALL), settings(mpc), 20.0, False, known=cold).plan.sum() > first.plan.sum()


def test_without_an_answer_it_is_a_thermostat_that_is_ready_when_the_night_setback_ends(mpc: ModuleType) -> None:
    for temperature, heating, power in ((19.9, False, 4e3), (20.1, False, 0.0), (20.1, True, 4e3), (20.4, True, 0.0)):
        decision = mpc.decide(NOBODY, settings(mpc), temperature, heating)
        assert decision[:3] == (power, "thermostat", "connection refused")

    def low(steps: int) -> list[float]:
        return [17.0, 17.0, 17.0, 20.0, 20.0][:steps]

    decision = mpc.decide(NOBODY, settings(mpc), 18.0, False, low=low)
    assert decision.power == 4000.0, "in an hour it has to be 20 degC"
    assert mpc.decide(NOBODY, settings(mpc), 18.0, False, low=lambda steps: [17.0] * steps).power == 0.0


def test_without_a_measurement_it_goes_on_as_before_the_measurement_was_lost(mpc: ModuleType) -> None:
    memory, day = mpc.Memory(settings(mpc, step=1800.0)), 86400.0
    with pytest.raises(ValueError, match="nothing is known of the day before"):
        memory.blind(0.0)
    for look in range(288):
        memory.heated(300.0 * look, 100.0 + look, measured=True)
    memory.planned(day - 5400.0, np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]))
    memory.planned(day - 1800.0, np.array([9.0, 9.0]))
    # The sensor was stuck before that was noticed, and the last plan has believed it.
    assert memory.left(day).tolist() == [9.0]
    assert memory.blind(day)[:2] == (4.0, "last plan")
    assert memory.blind(day + 3600.0)[:2] == (6.0, "last plan")
    # Then as at the same time of the day before, on average over a step.
    assert memory.blind(day + 5400.0)[:2] == (100.0 + 18 + 2.5, "day before")
    # On the second day as on the first.
    for look in range(288, 576):
        memory.heated(300.0 * look, 7.0, measured=False)
    assert memory.blind(2 * day + 5400.0)[:2] == (7.0, "day before")


def test_what_thermogate_refuses_falls_back_with_the_sentence(mpc: ModuleType, asking: Any) -> None:
    def ask(method: str, path: str, body: Any = None) -> Any:
        if body is not None:
            body["plans"][0]["inputs"]["office"]["u_heat"] = 9000.0
        return asking(ALL)(method, path, body)

    decision = mpc.decide(ask, settings(mpc), 19.0, False)
    assert "plans 9000 W; 0 to 4000 W can be planned" in decision.reason
    # A zone that has just begun is left to the thermostat.
    decision = mpc.decide(asking(), mpc.Settings("new"), 19.0, False)
    assert (decision.by, "learning" in decision.reason) == ("thermostat", True)


def twins(asking: Any, **trusts: str) -> Any:
    """An `Ask` of the room "office", and of a "twin" that is just like it, for which other `trusts` may be told."""
    own = {name: asking(ALL | {int(lead.lstrip("s")): word for lead, word in told.items()}) for name, told in
           (("office", {}), ("twin", trusts))}  # fmt: skip

    def ask(method: str, path: str, body: Any = None) -> Any:
        zone = "twin" if "twin" in path or (body and body["zones"] == ["twin"]) else "office"
        if body:
            plans = [{"inputs": {"office": one["inputs"][zone]}} for one in body["plans"]]
            body = body | {"zones": ["office"], "plans": plans}
        return own[zone](method, path.replace("twin", "office"), body)

    return ask


def pair(mpc: ModuleType, temperature: float = 19.0, **changes: Any) -> list[Any]:
    rooms = [settings(mpc, **changes), replace(settings(mpc, **changes), zone="twin")]
    return [mpc.Room(each, temperature, False) for each in rooms]


TIMES = ("2026-01-15T12:00:00Z", "2026-01-16T00:00:00Z")
SERIES = {"times": TIMES, "end": "2026-01-16T12:00:00Z", "inputs": [{"channel": "T_out", "values": [-7.0, 7.0]}]}
"""What a daemon tells of the last day, as far as the controller reads it."""


def cold(steps: int) -> Any:
    return {name: {"T_out": [-10.0 if k < 48 else 5.0 for k in range(steps)]} for name in ("office", "twin")}


def test_rooms_that_share_nothing_are_planned_as_each_alone(mpc: ModuleType, asking: Any) -> None:
    alone = mpc.decide(asking(ALL), settings(mpc), 19.0, False)
    for decision in mpc.decide_together(twins(asking), pair(mpc)):
        assert np.allclose(decision.plan, alone.plan, atol=1.0)
        assert decision.reason == alone.reason


def test_rooms_under_one_limit_heat_in_turns_and_begin_earlier(mpc: ModuleType, asking: Any) -> None:
    def low(steps: int) -> list[float]:
        return [18.0 if k < 24 else 21.0 for k in range(steps)]

    rooms = [room._replace(low=low) for room in pair(mpc)]
    free = mpc.decide_together(twins(asking), rooms, known=cold)
    together = np.sum([decision.plan for decision in free], axis=0)
    limit = 0.7 * float(together.max())
    kept = mpc.decide_together(twins(asking), rooms, known=cold, plant=mpc.Plant(limit))
    limited = np.sum([decision.plan for decision in kept], axis=0)
    assert {decision.by for decision in kept} == {"plan"}
    assert limited.max() <= limit + 1e-3
    assert limited[:23].sum() > together[:23].sum() + 100.0, "what is missing later is heated before"


def test_a_heat_pump_gives_more_heat_when_it_is_warm_outdoors(mpc: ModuleType, asking: Any) -> None:
    pump = mpc.Plant(limit=700.0, cop=((-10.0, 2.0), (5.0, 4.0)))
    plans = [one.plan for one in mpc.decide_together(twins(asking), pair(mpc), known=cold, plant=pump)]
    heat = np.sum(plans, axis=0)
    assert heat[:48].max() <= 1400.0 + 1e-3
    assert 1400.0 < heat[48:].max() <= 2800.0 + 1e-3
    # Where heat costs half as much in the second half of the day, less is stored before it.
    steady = [one.plan for one in mpc.decide_together(twins(asking), pair(mpc), known=cold, plant=mpc.Plant(1400.0))]
    assert heat[:48].sum() <= np.sum(steady, axis=0)[:48].sum() + 1.0


def test_the_outdoor_temperature_to_come_is_that_of_the_day_before_if_nobody_knows_it(
    mpc: ModuleType, daemon_ended: Any
) -> None:
    daemon, zone = daemon_ended
    pump, ask = mpc.Plant(cop=((-10.0, 2.0), (30.0, 4.0))), mpc.rest(daemon.url())
    told = mpc.Settings(zone)
    found = mpc.heat_ahead(ask, told, pump, 192, mpc.nothing_known)
    (outdoor,) = (one for one in ask("GET", f"/zones/{zone}/series", None)["inputs"] if one["channel"] == "T_out")
    values = pump.heat_per_watt(np.array(outdoor["values"], dtype=float))
    assert values.min() - 1e-6 <= found.min() < found.max() <= values.max() + 1e-6
    assert np.allclose(found[:96], found[96:])
    with pytest.raises(ValueError, match=r"no outdoor temperature \(T_sea\) is known"):
        mpc.heat_ahead(ask, told, pump._replace(outdoor="T_sea"), 96, mpc.nothing_known)


def test_a_room_with_a_thermostat_comes_first_and_the_coldest_before_others(mpc: ModuleType, asking: Any) -> None:
    plant = mpc.Plant(5000.0)
    planned, other = mpc.decide_together(twins(asking, s3600="untrusted"), pair(mpc, 17.0), known=cold, plant=plant)
    assert (planned.by, other.by, other.power) == ("plan", "thermostat", 4000.0)
    assert planned.plan[:4].max() <= 1000.0 + 1e-3

    warmer, colder = (room._replace(temperature=t) for room, t in zip(pair(mpc), (19.0, 18.0), strict=True))
    assert [one.power for one in mpc.decide_together(NOBODY, [warmer, colder], plant=plant)] == [1000.0, 4000.0]


def test_a_look_at_several_rooms_never_asks_for_more_than_the_limit(
    mpc: ModuleType, asking: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    def ask(method: str, path: str, body: Any = None) -> Any:
        answers = {"history": {"rows": [{"time": TIMES[0], "y": 20.5}]}, "series": SERIES}
        told = next((answer for name, answer in answers.items() if f"/{name}?" in path), None)
        return told or twins(asking)(method, path, body)

    plant = mpc.Plant(limit=600.0, cop=((-7.0, 2.5), (7.0, 3.5)))
    rooms = [mpc.Controlled(room.settings) for room in pair(mpc, low=22.0, high=25.0)]
    for now in (0.0, 300.0):
        mpc.look(ask, rooms, plant, now)
        assert 0.0 < sum(room.power for room in rooms) <= 600.0 * 3.5
    told = capsys.readouterr().out.splitlines()
    assert [line.partition(":")[0] for line in told] == ["office", "twin"] * 2
    assert all(" W by plan at " in line for line in told)


def test_a_room_of_which_nothing_is_known_is_left_all_that_it_can_take(mpc: ModuleType, asking: Any) -> None:
    def ask(method: str, path: str, body: Any = None) -> Any:
        if "/history?" in path:
            return {"rows": [] if "twin" in path else [{"time": TIMES[0], "y": 20.5}]}
        return twins(asking)(method, path, body)

    rooms = [mpc.Controlled(room.settings) for room in pair(mpc, low=22.0, high=25.0)]
    for now in (0.0, 300.0):
        mpc.look(ask, rooms, mpc.Plant(5000.0), now)
        assert 0.0 < rooms[0].power <= 1000.0 + 1e-3
    assert rooms[0].decision.plan[:4].max() <= 1000.0 + 1e-3, "the plan knows it"
    mpc.look(ask, rooms, mpc.Plant(3000.0), 900.0)
    assert rooms[0].power == 0.0


@pytest.fixture(scope="module")
def daemon_ended(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Daemon, str]]:
    """A daemon whose recording has come to its end, and its zone."""
    folder = tmp_path_factory.mktemp("ended")
    overrides = {"site.state_dir": str(folder / "state"), "zones.0.estimator": "ekf"}
    with Daemon(EXAMPLES / "generic-csv.toml", folder / "log", overrides) as daemon:
        (zone,) = daemon.wait_until_ended()
        yield daemon, zone


@tabled
def test_what_is_asked_for_wrongly_is_said(
    mpc: ModuleType, words: list[str], gist: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        mpc.main(words)
    assert gist in capsys.readouterr().err


def test_it_runs_against_a_daemon(mpc: ModuleType, daemon_ended: Any, capsys: pytest.CaptureFixture[str]) -> None:
    daemon, zone = daemon_ended
    arguments = ["--url", daemon.url(), "--zone", f"{zone}=1500", "--step", "600", "--times", "1"]
    assert mpc.main([*arguments, "--limit", "500", "--cop", "3.4@2", "2.6@-7"]) == 0
    # The recording has come to its end, so nobody knows any more how warm it is.
    told = capsys.readouterr()
    assert told.out == ""
    assert "no decision (nothing is measured" in told.err
    assert "the plant's own thermostat has to heat" in told.err
    with pytest.raises(SystemExit):
        mpc.main(["--help"])
    assert "the heater's largest power, W (default 2000.0)" in " ".join(capsys.readouterr().out.split())


def test_a_temperature_that_nobody_vouches_for_is_none(mpc: ModuleType) -> None:
    def measured(state: str) -> Any:
        history = {"rows": [{"time": "2026-01-15T12:00:00Z", "y": 20.5}]}
        return mpc.measured(lambda _, path, body: history if "history" in path else {"status": {"state": state}}, "o")

    found = {state: measured(state)[1] for state in ("running", "stalled", "failed")}
    assert found == {"running": 20.5, "stalled": None, "failed": None}
    assert measured("running")[0] == 1768478400.0
    with pytest.raises(ValueError, match="the zone has no sample yet"):
        mpc.measured(lambda *_: {"rows": []}, "new")


def test_no_plan_is_a_hair_beyond_what_the_heater_can(mpc: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    solved = SimpleNamespace(success=True, x=np.array([-1e-9, 4000.0 + 1e-6, 0.0, 0.0, 0.0, 0.0]))
    monkeypatch.setattr(mpc, "linprog", lambda *_, **__: solved)
    two = np.ones(2)
    assert mpc.plan(np.eye(2), two, two, two, two, 4000.0 * two, 1.0).tolist() == [0.0, 4000.0]


def test_an_answer_that_breaks_off_is_none(mpc: ModuleType) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer() -> None:
            with server.accept()[0] as client:
                client.recv(65536)
                client.sendall(b'HTTP/1.1 200 OK\r\nContent-Length: 5000\r\n\r\n{"rows": ')

        breaking = threading.Thread(target=answer)
        breaking.start()
        ask = mpc.rest(f"http://127.0.0.1:{server.getsockname()[1]}")
        with pytest.raises(OSError, match="the answer broke off"):
            ask("GET", "/zones/office", None)
        breaking.join()
