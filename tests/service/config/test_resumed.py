"""Which estimator a zone has that names none: the default, or the one that its state belongs to."""

from pathlib import Path
from typing import Any

import pytest
from support.config_samples import changed as written
from support.config_samples import learned

from estimator.bank.options import DEFAULT_MEMBERS
from service.config.fitting import fingerprint
from service.config.load import load
from service.config.site import Config
from service.store.store import JOURNAL


def estimators(config: Config) -> list[str]:
    return [zone.estimator for zone in config.zones]


def test_a_new_zone_is_a_bank_and_the_options_of_today_are_an_rbpf(tmp_path: Path) -> None:
    assert estimators(load(written(tmp_path))) == ["bank", "bank"]
    few = load(written(tmp_path, estimator_options={"particles": 50}))
    assert estimators(few) == ["rbpf", "bank"]
    assert few.zones[0].options.particles == 50
    assert estimators(load(written(tmp_path, estimator_options={}))) == ["bank", "bank"]


def test_a_bank_goes_on_with_other_priors_but_not_with_other_members(tmp_path: Path) -> None:
    members = {"near": {"estimator": "mkf", "particles": 16}, "far": {"estimator": "arx"}}

    def mark(**changed: Any) -> str:
        tables = {
            name: {**table, **changed.get(name, {})} for name, table in members.items() if changed.get(name) != {}
        }
        return fingerprint(load(written(tmp_path, estimator="bank", estimator_options={"members": tables})).zones[0])

    assert mark(near={"prior": 2.0}, far={"memory_days": 3.0}) == mark()
    assert mark(far={}) != mark()
    assert mark(far={"past_outputs": 3}) != mark()
    assert mark(near={"particles": 32}) != mark()


def test_state_of_a_bank_or_of_another_estimator_leaves_the_default(tmp_path: Path) -> None:
    learned(load(written(tmp_path)), 0)
    learned(load(written(tmp_path, estimator="rbpf")), 1)
    assert [list(zone.options.members) for zone in load(written(tmp_path)).zones] == 2 * [list(DEFAULT_MEMBERS)]


@pytest.mark.parametrize("content", [b"", b"no database"])
def test_a_journal_that_cannot_be_read_leaves_the_default(tmp_path: Path, content: bytes) -> None:
    path = written(tmp_path)
    journal = load(path).site.state_dir / JOURNAL
    journal.parent.mkdir(parents=True)
    journal.write_bytes(content)
    assert estimators(load(path)) == ["bank", "bank"]
