"""Measured buildings that others have fitted and published; the data are not part of the project."""

from pathlib import Path

import pytest

from estimator.network import presets
from estimator.offline.least_squares import Segment, fit_open_loop
from replay.errors import ReplayError
from replay.lab.experiments.recordings import RECORDINGS, at_hand
from replay.localtime import HOUR

DATA = Path(__file__).parents[5] / "shared" / "data"
measured = pytest.mark.skipif(not DATA.is_dir(), reason="the measured data are not beside the project")


@measured
def test_a_fit_is_no_worse_than_what_darkgreybox_publishes() -> None:
    """Published for TiTeThRia on the first 672 h: .3719 K."""
    recording = RECORDINGS["darkgreybox demo"](DATA)
    assert recording is not None
    network = presets.network("titethria")
    for parameter in network.parameters:
        # A heating power of up to 158 kW: more building than the preset's box allows for.
        lower, upper = (1e6, 1e12) if parameter.unit == "J/K" else (10.0, 1e6)
        network = network.with_parameter(parameter.name, lower=lower, upper=upper, nominal=None)
    segment = Segment(recording.series.inputs[:672], recording.series.outputs[:672])
    assert fit_open_loop(network, HOUR, [segment], starts=6).rmse < 0.372


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("Time,T_ext,T_int\n0,1,2\n0,1,2\n", "'P_hea' is not what docs/benchmark.md says"),
        ("T_ext,P_hea,I_sol,T_int\n1,x,2,3\n1,1,2,3\n", "could not convert string to float: 'x' is not what"),
        ("T_ext,P_hea,I_sol,T_int\n1,1,,3\n1,1,2,3\n", "it has gaps"),
    ],
)
def test_another_file_under_the_name_is_refused(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "armadillo").mkdir()
    (tmp_path / "armadillo/armadillo_data_H2.csv").write_text(text, encoding="utf-8")
    with pytest.raises(ReplayError, match=said):
        at_hand(tmp_path, ["armadillo"])
