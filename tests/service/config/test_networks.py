"""From the network table of a zone to the estimator's network."""

from dataclasses import replace
from typing import Any

import pytest

from estimator.network import presets
from estimator.network.network import Network
from service.config.network_tables import network_model
from service.config.networks import resolve
from service.config.written import network_table


def built(table: dict[str, Any]) -> Network:
    model, long_form = network_model(table)
    network, mistakes = resolve(model.model_validate(long_form))
    assert not mistakes
    assert network is not None
    return network


@pytest.mark.parametrize("name", presets.PRESETS)
def test_a_preset_written_out_as_inline_network_is_the_same_network(name: str) -> None:
    preset = built({"preset": name})
    assert preset == presets.network(name)
    again = built(network_table(preset))
    assert replace(again, parameters=set(again.parameters)) == replace(  # type: ignore[arg-type]
        preset,
        parameters=set(preset.parameters),  # type: ignore[arg-type]
        description="",
        initial={node: preset.initial_temperature(node) for node in preset.nodes},
    )


def test_network_without_heat_inputs() -> None:
    table = network_table(presets.network("tite"))
    del table["heat_inputs"]
    assert built(table).channels == ("T_i", "T_out")
