"""Every example configuration passes its check."""

from __future__ import annotations

from pathlib import Path

import pytest

from service.cli.main import main
from service.config.load import load

EXAMPLES = Path(__file__).parents[3] / "deploy/examples"


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.toml")), ids=lambda path: path.stem)
def test_example_passes_its_check(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(path)]) == 0

    shown = capsys.readouterr()
    assert shown.out.startswith("OK: site '")
    assert shown.err == ""
    warnings = [line for line in shown.out.splitlines() if line.startswith("warning:")]
    assert all("it covers" in warning for warning in warnings), "the stand-ins are short, and nothing else is doubtful"


def test_ecolar_is_preprocessed_as_in_the_paper() -> None:
    (zone,) = load(EXAMPLES / "ecolar.toml").zones

    assert (zone.period, zone.max_gap, zone.hold_inputs) == (300, 0, 0)
    assert zone.channels["u_heat"].source_columns == ("my-pv1", "my-pv2", "my-pv3", "Relay 4", "Relay 5")
    assert {name: channel.aggregate for name, channel in zone.channels.items()} == {
        "T_air": "mean",
        "T_out": "mean",
        "T_adj": "mean",
        "u_heat": "first",
    }


@pytest.mark.parametrize("name", ["building-67", "ecolar"])
def test_paper_examples_use_the_paper_preset(name: str) -> None:
    (zone,) = load(EXAMPLES / f"{name}.toml").zones

    assert zone.estimator_options == {"preset": "paper"}
