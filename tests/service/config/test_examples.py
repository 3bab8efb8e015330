"""Every example configuration passes its check, which asks no database."""

from pathlib import Path

import pytest
from support.harness import EXAMPLES

from service.cli.main import main
from service.config.load import load

OF_DATABASES = EXAMPLES.parents[1] / "adapters" / "series" / "sample.toml"


@pytest.mark.parametrize("path", [*sorted(EXAMPLES.glob("*.toml")), OF_DATABASES], ids=lambda path: path.stem)
def test_example_passes_its_check(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(path)]) == 0
    shown = capsys.readouterr()
    assert shown.out.startswith("OK: site '")
    assert shown.err == ""
    warnings = [line for line in shown.out.splitlines() if line.startswith("warning:")]
    assert all("it covers" in warning for warning in warnings), "the stand-ins are short, and nothing else is doubtful"


def test_examples_of_the_paper_are_as_in_the_paper() -> None:
    (ecolar,), (building,) = (load(EXAMPLES / f"{name}.toml").zones for name in ("ecolar", "building-67"))
    assert ecolar.estimator_options == building.estimator_options == {"preset": "paper"}
    assert (ecolar.period, ecolar.max_gap, ecolar.hold_inputs) == (300, 0, 0)
    assert ecolar.channels["u_heat"].source_columns == ("my-pv1", "my-pv2", "my-pv3", "Relay 4", "Relay 5")
    aggregates = {name: channel.aggregate for name, channel in ecolar.channels.items()}
    assert aggregates == {"T_air": "mean", "T_out": "mean", "T_adj": "mean", "u_heat": "first"}
