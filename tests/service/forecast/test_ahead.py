"""The hours ahead that are announced without being asked for."""

import asyncio
import json
import math
from dataclasses import replace

import pytest
from support.fake_zones import foreseen, make_update, running, waiting
from support.running_zone import Announced
from support.waiting import until

from estimator.network import presets
from service.errors import ServiceError
from service.forecast.ahead import EVERY, LookingAhead
from service.publish.sinks import Occasion
from service.records.trust import HorizonTrust, Trust

DAY = 86400


@pytest.fixture
def zone():
    return running("living")


def looking(*zones):
    sink = Announced()
    return LookingAhead("htwg", {zone.id: zone for zone in zones}, [sink]), sink


def told(sink):
    return [json.loads(one.payload("ahead")) for one in sink.told]


def test_horizons_and_fan_are_those_of_the_forecast_without_a_plan(zone):
    ahead, sink = looking(zone, waiting("attic"))
    asyncio.run(ahead.attend("living"))
    asyncio.run(ahead.attend("attic"))
    asyncio.run(ahead.attend("nowhere"))
    (one,) = sink.told
    assert (one.occasion, one.topics) == (Occasion.STATUS, ("ahead", "status"))
    (published,) = zone.now().update.forecast.outputs
    (found,) = told(sink)
    assert (found["level"], found["step_s"], found["quality"], found["heating"]) == (0.95, 1800.0, "good", None)
    (output,) = found["outputs"]
    # The mean of the fake rises by 0.01 K a step of 300 s, and its first step is the published one.
    assert [one["lead_s"] for one in output["horizons"]] == [3600, 6 * 3600, DAY]
    for one in output["horizons"]:
        steps = one["lead_s"] / 300 - 1
        assert one["mean"] == pytest.approx(published.mean + 0.01 * steps)
        assert one["sd"] == pytest.approx(published.sd * math.sqrt(1 + steps))
        assert one["upper"] - one["mean"] == pytest.approx(1.96 * one["sd"], rel=1e-3)
    assert found["outputs"][0]["mean"] == pytest.approx([published.mean + 0.06 * k for k in range(48)])
    assert len(output["lower"]) == len(output["upper"]) == 48


def test_another_look_is_taken_after_some_minutes_of_the_zone(zone):
    ahead, sink = looking(zone)
    for step in range(3, 3 + 3 * EVERY // 300):
        asyncio.run(ahead.attend("living"))
        asyncio.run(ahead.attend("living"))
        zone.updates.append(make_update(step, zone.network))
    assert [one["sample_time"] for one in told(sink)] == sorted({one["sample_time"] for one in told(sink)})
    assert len(sink.told) == 3


def test_the_looks_rest_but_not_after_the_first_which_compiles(monkeypatch):
    rests = []

    async def rest(seconds):
        rests.append(seconds)

    monkeypatch.setattr(asyncio, "sleep", rest)
    zones = [running(name) for name in ("living", "attic", "cellar")]
    ahead, _ = looking(*zones)
    for zone in zones:
        asyncio.run(ahead.attend(zone.id))
    assert len(rests) == 2


def test_a_zone_that_no_longer_vouches_for_it_says_so_once_and_comes_back(zone):
    ahead, sink = looking(zone)
    for state in ("running", "stalled", "stalled", "running"):
        zone.state = state
        asyncio.run(ahead.attend("living"))
    assert [one["quality"] for one in told(sink)] == ["good", "bad", "good"]


def test_the_next_heating_is_told_unless_hardly_any_start_suffices_or_the_forecast_is_not_trusted(zone):
    zone.heating = foreseen(zone)
    ahead, sink = looking(zone)
    asyncio.run(ahead.attend("living"))
    heating = told(sink)[0]["heating"]
    assert (heating["target"], heating["probability"], heating["reached"]) == (21.0, 0.9, 0.93)
    assert heating["start"] < heating["by"]
    sure, zone.heating = zone.heating, replace(zone.heating, start=None, reached=0.4)
    zone.updates.append(make_update(10, zone.network))
    asyncio.run(ahead.attend("living"))
    zone.heating = sure
    zone.trusted = Trust(0, (HorizonTrust(DAY, "untrusted", "the intervals held 3 % of what came", 0),))
    zone.updates.append(make_update(20, zone.network))
    asyncio.run(ahead.attend("living"))
    assert [one["heating"] for one in told(sink)[1:]] == [None, None]


@pytest.mark.parametrize(("period", "leads"), [(1, []), (2, [3600]), (3600, [6 * 3600, DAY]), (DAY, None)])
def test_periods_of_any_length_have_the_horizons_that_fit(period, leads, zone):
    zone.period = float(period)
    update = zone.now().update
    ended = update.time + period
    zone.updates[-1] = update._replace(forecast=update.forecast._replace(issue_time=ended, valid_time=ended))
    ahead, sink = looking(zone)
    asyncio.run(ahead.attend("living"))
    found = [[one["lead_s"] for one in document["outputs"][0]["horizons"]] for document in told(sink)]
    assert found == ([] if leads is None else [leads])


async def test_it_goes_on_where_one_zone_fails(zone):
    class Failing:
        def __init__(self, error):
            self.id, self.network, self.error = type(error).__name__, presets.network("tite"), error

        def now(self):
            raise self.error

    ahead, sink = looking(Failing(ServiceError("away")), Failing(RuntimeError("odd")), zone)
    looks = asyncio.create_task(ahead.run())
    await until(lambda: sink.told)
    zone.updates.append(make_update(10, zone.network))
    # The looks rest in between; what comes meanwhile is not missed.
    ahead.news.publish(sink.told[0])
    await until(lambda: len(sink.told) == 2)
    looks.cancel()
    assert [one.zone for one in sink.told] == ["living", "living"]
