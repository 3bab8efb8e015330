"""`thermogate learn`: history into the state of a daemon's zones."""

import os
import re
import shutil
import signal
import subprocess
from pathlib import Path

import numpy as np
import pytest
from support.harness import INTERRUPTIBLE
from support.tables import tabled
from support.waiting import wait_until

import thermogate as tg
from replay.recorded import learning
from replay.recorded.learning import learn
from replay.recorded.tables import cells, utc_stamps, write_table
from service.cli.main import main
from service.config.fitting import fingerprint, make_worker
from service.config.load import load, load_history
from service.errors import ConfigError, ServiceError
from service.recordings.history import survey
from service.store.reading import read_state
from service.store.store import locked
from service.zone import snapshot

RECORDING = Path(__file__).parents[3] / "deploy" / "examples" / "data" / "generic.csv"

PLANT, HISTORY = (Path(__file__).with_name(f"{name}.toml").read_text(encoding="utf-8") for name in ("plant", "history"))
HISTORY = HISTORY.replace("RECORDING", str(RECORDING))


def written(folder, plant=PLANT, history=HISTORY):
    folder.mkdir(exist_ok=True)
    (folder / "plant.toml").write_text(plant)
    (folder / "history.toml").write_text(history)
    return folder / "plant.toml", folder / "history.toml"


def surveyed(config, start=None, end=None):
    return survey(config, config.zones, start, end)


def learned(folder, start=None, end=None, history=HISTORY, reset=()):
    config = load_history(*written(folder, history=history))
    return learn(config, surveyed(config, start, end), jobs=1, reset=reset)


def state_of(folder):
    """Samples, history and the newest checkpoint of the zone as the daemon would find them."""
    zone = load(folder / "plant.toml").zones[0]
    with read_state(folder / "state") as state:
        samples = list(state.journal.samples_after("room", None))
        rows = state.journal.history("room", None, None, 10_000)
        return zone, samples, rows, state.checkpoint("room", fingerprint(zone))


def assert_same(first, second):
    assert first.step == second.step
    assert first.arrays.keys() == second.arrays.keys()
    for name, value in first.arrays.items():
        assert np.array_equal(value, second.arrays[name], equal_nan=value.dtype.kind == "f"), name


def assert_same_state(first, second):
    # As text: a set-point that nobody tells is NaN.
    assert list(map(repr, first[1])) == list(map(repr, second[1]))
    assert_same(first[3], second[3])


@pytest.fixture(autouse=True)
def chunks(monkeypatch):
    """Several checkpoints in a recording of two days."""
    monkeypatch.setattr(learning, "_CHUNK", 40)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    return folder, learned(folder)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can write what another account cannot read")
def test_root_learns_nothing_for_an_account_that_could_not_read_it(tmp_path, capsys):
    plant, history = written(tmp_path)
    (tmp_path / "state").mkdir()
    os.chown(tmp_path / "state", 12345, 12345)
    assert main(["learn", str(plant), "--from", str(history)]) == 1
    assert "state belongs to account 12345, which could not read what root learns" in capsys.readouterr().err
    assert not list((tmp_path / "state").iterdir())


def test_the_zone_of_a_live_configuration_stands_where_the_recording_ends(whole):
    folder, result = whole
    zone, samples, rows, checkpoint = state_of(folder)
    assert [trace.zone for trace in result.traces] == ["room"]
    assert len(samples) == len(rows) == 192
    assert checkpoint.step == samples[-1].time == rows[-1].time
    worker = make_worker(zone)
    updates = [update for sample in samples if (update := worker.step(sample)) is not None]
    inputs = result.traces[0].inputs[:, zone.network.inputs.index("u_heat")]
    assert inputs[-len(samples) + 1 :].tolist() == [sample.inputs[1] for sample in samples[1:]]
    assert [row.mean for row in rows[1:]] == [update.score.mean[0] for update in updates[1:]]
    assert_same(checkpoint, snapshot.take(worker, fingerprint(zone), "ekf"))


def test_what_was_learned_is_a_model_in_a_notebook(whole):
    assert "learned from 192 samples" in str(tg.load(whole[0] / "state"))


def test_a_second_run_finds_nothing_new_and_changes_nothing(whole, tmp_path):
    shutil.copytree(whole[0], tmp_path / "again")
    before = state_of(tmp_path / "again")
    result = learned(tmp_path / "again")
    assert result.traces == []
    assert result.known == {"room": len(before[1])}
    assert_same_state(state_of(tmp_path / "again"), before)


def test_a_run_that_was_interrupted_goes_on_with_the_same_bits(whole, tmp_path):
    folder = tmp_path / "parts"
    _, samples, _, _ = state_of(whole[0])
    learned(folder, end=samples[100].time)
    # The process was killed after the journal had the samples and before the checkpoints were written.
    shutil.rmtree(folder / "state" / "checkpoints")
    assert learned(folder).known == {"room": 100}
    assert_same_state(state_of(folder), state_of(whole[0]))


def zone_of(text, changes):
    """The zone of a configuration after `changes` of words."""
    zone = "".join(text.partition("[[zones]]")[1:])
    for old, new in changes.items():
        zone = zone.replace(old, new)
    return zone


def two_rooms(folder):
    """Two rooms of one recording of days, of which the second is a little warmer."""
    rng, k = np.random.default_rng(1), np.arange(96 * 10)
    heat = 1500.0 * np.isin(k % 96, np.arange(24, 80))
    rooms = {"first": 20.0 + 0.001 * heat + rng.normal(0.0, 0.05, k.size), "second": 21.0 + 0.001 * heat}
    rooms |= {"outdoors": 5.0 * np.sin(k / 15.3), "power": heat}
    numbers = {name: cells(values, 3) for name, values in rooms.items()}
    write_table(folder / "days.csv", {"time": utc_stamps(1_735_689_600 + 900 * k), **numbers})
    columns = {"Aussentemperatur": "outdoors", "Heizleistung_kW": "power", '"kW"': '"W"'}
    plant = PLANT.partition("[[zones]]")[0]
    history = f'[sources.export]\nkind = "csv"\nfiles = ["{folder / "days.csv"}"]\ntimestamp = {{ column = "time" }}\n'
    for name in ("first", "second"):
        own = {'"room"': f'"{name}"'}
        plant += zone_of(PLANT, own)
        history += zone_of(HISTORY, own | {"Raumtemperatur": name, **columns})
    return plant, history


def learned_by_command(folder, *, interrupted=False):
    """What the command told, ended by Ctrl-C after the first checkpoint of both rooms where it is `interrupted`."""
    options = ["learn", "plant.toml", "--from", "history.toml", "--jobs", "2"]
    with subprocess.Popen([*INTERRUPTIBLE, *options], stderr=subprocess.PIPE, text=True, cwd=folder) as process:
        if interrupted:
            wait_until(
                lambda: {path.parent.name for path in folder.glob("state/checkpoints/*/*.npz")} == {"first", "second"}
            )
            process.send_signal(signal.SIGINT)
        _, told = process.communicate(timeout=300)
    return process.returncode, told


def test_several_zones_learn_at_once_and_go_on_after_ctrl_c(tmp_path):
    plant, history = two_rooms(tmp_path)
    found = {}
    for name in ("whole", "parts"):
        written(tmp_path / name, plant, history)
        if name == "parts":
            code, told = learned_by_command(tmp_path / name, interrupted=True)
            assert code == 130
            assert "Traceback" not in told
        assert learned_by_command(tmp_path / name)[0] == 0
        assert (tmp_path / name / "report.html").exists()
        config = load(tmp_path / name / "plant.toml")
        with read_state(tmp_path / name / "state") as state:
            found[name] = {zone.id: state.checkpoint(zone.id, fingerprint(zone)) for zone in config.zones}
            known = {zone.id: len(list(state.journal.samples_after(zone.id, None))) for zone in config.zones}
        assert known == {"first": 96 * 10, "second": 96 * 10}
    for name in ("first", "second"):
        assert_same(found["parts"][name], found["whole"][name])


def test_of_a_long_history_the_last_weeks_are_learned_from_and_some_before(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(learning, "WHOLE", 86_400)
    monkeypatch.setattr(learning, "ONE_OF", 5)
    plant, history = written(tmp_path)
    assert main(["learn", str(plant), "--from", str(history), "--out", str(tmp_path)]) == 0
    told = r"zone 'room': 192 samples from 20.*measured in 100 %.*one week in 5 is learned from, from then on every one"
    assert re.search(told, capsys.readouterr().out, re.DOTALL)
    samples = state_of(tmp_path)[1]
    assert len(samples) == 97
    weeks = [samples[0]._replace(time=604_800 * week) for week in range(2800, 2900)]
    assert [one.time // 604_800 for one in learning.chosen(weeks)] == [*range(2800, 2900, 5), 2899]


def test_a_zone_that_learned_from_a_mistake_is_reset(whole, tmp_path):
    learned(tmp_path, history=HISTORY.replace('"kW"', '"W"'))
    assert learned(tmp_path).traces == []
    learned(tmp_path, reset=["room"])
    assert_same(state_of(tmp_path)[3], state_of(whole[0])[3])


def test_a_history_without_the_room_is_none(tmp_path):
    config = load_history(*written(tmp_path, history=HISTORY.replace("Raumtemperatur", "Zeit")))
    (history,) = surveyed(config).values()
    assert history.described == "zone 'room': nothing usable; refused: 192 non_numeric"
    assert learn(config, {"room": history}, jobs=1).traces == []


def test_a_schedule_of_set_points_holds_for_the_past_too(tmp_path):
    days = '{ on = ["mon", "tue", "wed", "thu", "fri", "sat", "sun"], at = { "06:00" = 21.0, "22:00" = 17.0 } }'
    hours = f'sources.hours={{ kind = "schedule", time_zone = "Europe/Berlin", days = [{days}] }}'
    config = load_history(*written(tmp_path), [hours, 'zones.room.setpoint={ source = "hours" }'])
    assert not config.warnings
    learn(config, surveyed(config), jobs=1)
    assert [sample.setpoint for sample in state_of(tmp_path)[1]] == 2 * (24 * [17.0] + 64 * [21.0] + 8 * [17.0])


def test_a_history_of_what_is_still_to_come_is_refused(tmp_path, capsys):
    (tmp_path / "late.csv").write_text(RECORDING.read_text(encoding="utf-8").replace(".2025 ", ".2085 "))
    plant, history = written(tmp_path, history=HISTORY.replace(str(RECORDING), "late.csv"))
    assert main(["learn", str(plant), "--from", str(history)]) == 1
    assert "goes on until 2085-02-04T22:45:00Z, which is still to come" in capsys.readouterr().err


@tabled
def test_mistakes_in_a_history_are_explained(tmp_path, old, new, sentence):
    with pytest.raises(ConfigError) as raised:
        load_history(*written(tmp_path, history=HISTORY.replace(old, new)))
    assert any(sentence in problem for problem in raised.value.problems), raised.value.problems


def test_what_is_learned_goes_where_the_daemon_looks_for_it(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    paths = written(tmp_path / "etc", PLANT.replace('"state"', '"~/state"'))
    assert load_history(*paths).site.state_dir == load(paths[0]).site.state_dir == tmp_path / "state"


def test_a_history_of_one_of_the_zones_of_a_meter_has_its_share(tmp_path):
    paths = written(tmp_path, (PLANT + NEXT_DOOR).replace('unit = "W"', 'unit = "W", share = "boiler"'))
    config = load_history(*paths, ['zones.room.setpoint={ source = "bms", topic = "s", unit = "degC" }'])
    assert config.zones[0].network == load(paths[0]).zones[0].network
    assert "has no setpoint, which zone" in config.warnings[0]


def test_a_running_daemon_and_a_live_source_are_refused(tmp_path):
    config = load_history(*written(tmp_path))
    histories = surveyed(config)
    with locked(tmp_path / "state"), pytest.raises(ServiceError, match="another thermogate already runs"):
        learn(config, histories, jobs=1)
    with pytest.raises(ServiceError, match="is live"):
        surveyed(load(tmp_path / "plant.toml"))


def test_a_parquet_file_is_history_as_it_is(tmp_path):
    pd = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    table = pd.read_csv(RECORDING, sep=";", decimal=",", index_col="Zeit")
    table.index = pd.to_datetime(table.index, format="%d.%m.%Y %H:%M").tz_localize("Europe/Berlin")
    names = {"Raumtemperatur": "T_i", "Aussentemperatur": "T_out", "Heizleistung_kW": "u_heat"}
    table = table.rename(columns=names)
    table["u_heat"] *= 1000.0
    plant, history = written(tmp_path)
    expected = surveyed(load_history(plant, history))["room"].recorded.samples
    for prefix in ("", "room/"):
        table.add_prefix(prefix).assign(T_set=20.0).to_parquet(tmp_path / "history.parquet")
        config = load_history(plant, tmp_path / "history.parquet")
        assert config.warnings == ("sources.history: no channel is called like its columns T_set",)
        found = surveyed(config)["room"].recorded.samples
        assert [one.time for one in found] == [one.time for one in expected]
        np.testing.assert_allclose([one.inputs for one in found], [one.inputs for one in expected])
        np.testing.assert_allclose([one.outputs for one in found], [one.outputs for one in expected])


def test_a_parquet_file_without_the_channels_of_a_zone_is_refused(tmp_path):
    pd = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    plant, _ = written(tmp_path)
    path, times = tmp_path / "history.parquet", pd.date_range("2025-01-01", periods=3, freq="15min", tz="UTC")
    for columns, sentence in (
        ({"Room": 1.0}, "no column is called like a channel, such as room/T_i; its columns are when, Room"),
        ({"T_i": 1.0, "other": times}, "it has 2 columns of times, and needs one"),
        ({"T_i": 1.0}, "must name the same channels as zone"),
    ):
        pd.DataFrame({"when": times, **columns}).to_parquet(path, index=False)
        with pytest.raises(ConfigError, match=sentence):
            load_history(plant, path)


TAUGHT = ("site.neighbours=true",)
NEXT_DOOR = '\n[[zones]]\nid = "next"\n' + PLANT.partition('id = "room"\n')[2]


@pytest.fixture(scope="module")
def site(whole, tmp_path_factory):
    """A site in which `room` has learned, and another room is new."""
    folder = tmp_path_factory.mktemp("site")
    shutil.copytree(whole[0] / "state", folder / "state")
    return folder


def learned_next_door(folder, end=None, changes=()):
    paths = written(folder, PLANT + NEXT_DOOR, HISTORY.replace('id = "room"', 'id = "next"'))
    config, plant = load_history(*paths, changes), load(paths[0], changes)
    learn(config, surveyed(config, None, end), jobs=1, plant=plant)
    zone = next(zone for zone in plant.zones if zone.id == "next")
    with read_state(folder / "state") as state:
        return state.checkpoint("next", fingerprint(zone))


def test_a_new_zone_begins_with_what_the_others_have_learned(site, tmp_path):
    for name in ("taught", "alone"):
        shutil.copytree(site, tmp_path / name)
    taught = learned_next_door(tmp_path / "taught", changes=TAUGHT)
    alone = learned_next_door(tmp_path / "alone")
    assert [name for name in taught.arrays if name.startswith("began.")]
    assert not any(name.startswith("began.") for name in alone.arrays)
    assert not np.array_equal(taught.arrays["estimator.mean"], alone.arrays["estimator.mean"])


def test_what_a_zone_began_with_stays_whatever_the_others_learn(whole, site, tmp_path):
    shutil.copytree(site, tmp_path / "whole")
    shutil.copytree(site, tmp_path / "parts")
    samples = state_of(whole[0])[1]
    expected = learned_next_door(tmp_path / "whole", changes=TAUGHT)
    learned_next_door(tmp_path / "parts", samples[20].time, TAUGHT)
    # The process was killed before its first checkpoint, and the room has learned something else since.
    for path in (tmp_path / "parts" / "state" / "checkpoints" / "next").iterdir():
        if int(path.stem) > 0:
            path.unlink()
    shutil.rmtree(tmp_path / "parts" / "state" / "checkpoints" / "room")
    assert_same(learned_next_door(tmp_path / "parts", changes=TAUGHT), expected)
