"""Which estimator a zone has that names none: the default, or the one that its state belongs to."""

from pathlib import Path
from typing import Any

import pytest
from support.config_samples import changed as written
from support.config_samples import learned

from estimator.bank.options import DEFAULT_MEMBERS, former_members
from service.config.fitting import fingerprint
from service.config.load import load
from service.config.site import Config
from service.config.written import effective_toml
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


@pytest.mark.parametrize("network", ["tite", "auto"])
@pytest.mark.parametrize("given", [{}, {"estimator": "bank", "estimator_options": {"discount": 0.99}}])
@pytest.mark.parametrize("before_that", [0, 1])
def test_a_zone_with_state_of_the_former_members_goes_on_with_them(
    tmp_path: Path, network: str, given: dict[str, Any], before_that: int
) -> None:
    table = {"network": network, **given}
    former = former_members(load(written(tmp_path, **table)).zones[0].network)[before_that]
    options = {**given.get("estimator_options", {}), "members": former}
    before = load(written(tmp_path, **{**table, "estimator": "bank", "estimator_options": options}))
    learned(before, 0)
    now = load(written(tmp_path, **table))
    assert fingerprint(now.zones[0]) == fingerprint(before.zones[0])
    assert now.zones[0].options == before.zones[0].options
    assert list(now.zones[0].options.members) == list(former)
    assert list(now.zones[1].options.members) == list(DEFAULT_MEMBERS)
    kept = tmp_path / "kept.toml"
    kept.write_text(effective_toml(now), encoding="utf-8")
    assert fingerprint(load(kept).zones[0]) == fingerprint(before.zones[0])


def test_members_that_are_named_are_those_of_the_zone_whatever_is_stored(tmp_path: Path) -> None:
    former = former_members(load(written(tmp_path)).zones[0].network)[0]
    named = {"estimator": "bank", "estimator_options": {"members": {"near": {"estimator": "ekf"}}}}
    learned(load(written(tmp_path, estimator="bank", estimator_options={"members": former})), 0)
    assert list(load(written(tmp_path, **named)).zones[0].options.members) == ["near"]


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
