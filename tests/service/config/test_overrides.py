"""`--set dotted.key=value`."""

from typing import Any

from support.tables import tabled

from service.config.overrides import apply_overrides


@tabled
def test_values_are_toml_or_text(override: str, expected: object) -> None:
    assert apply_overrides({"a": {"x": 1}}, [override]) == {"a": {"x": expected}}


def test_list_items_by_index_and_by_id_which_goes_before() -> None:
    raw = {"zones": [{"id": "living", "period": 1}, {"id": "1", "period": 2}, {"id": "attic", "levels": [0.5, 0.9]}]}
    assert apply_overrides(raw, ["zones.0.period=10", "zones.attic.levels.1=0.8", "zones.1.period=20"])["zones"] == [
        {"id": "living", "period": 10},
        {"id": "1", "period": 20},
        {"id": "attic", "levels": [0.5, 0.8]},
    ]
    assert apply_overrides({"zones": [{"id": "1"}, {"id": "0"}]}, ["zones.0.period=5"])["zones"][0] == {"id": "1"}


def test_tables_are_made_quoted_keys_are_one_later_overrides_win_and_the_original_stays() -> None:
    assert apply_overrides({}, ['a."b.c".d=1']) == {"a": {"b.c": {"d": 1}}}
    raw: dict[str, Any] = {"http": {"port": 1}}
    assert apply_overrides(raw, ["http.port=2", "http.port=3"]) == {"http": {"port": 3}}
    assert raw == {"http": {"port": 1}}
