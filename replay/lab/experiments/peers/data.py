"""Measured buildings that others have fitted and published: read where they lie, for they cannot be shipped."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from estimator.network import presets
from estimator.network.network import Conductance, Gain, HeatInput, Network, Parameter
from replay.errors import ReplayError
from replay.experiments.series.filtering import Series
from replay.localtime import HOUR


class Published(NamedTuple):
    """Open-loop figures of others [K], and how they came to them; None: not reported."""

    who: str
    train_rmse: float | None = None
    train_mae: float | None = None
    test_rmse: float | None = None
    caveat: str = ""
    """What keeps the figures from being compared without more ado."""


class Case(NamedTuple):
    """A measured building, a network for it, and the split: rows before `train` are learned from, the rest is test.

    `period` in s; `measurement_sd` [K] is what the online estimators are told.
    """

    name: str
    what: str
    network: Network
    period: int
    series: Series
    train: int
    measurement_sd: float
    published: Published

    @property
    def columns(self) -> dict[str, Array]:
        """Channels (K,) by name."""
        series, network = self.series, self.network
        table = np.column_stack([series.outputs, series.inputs])
        return dict(zip(network.channels, table.T, strict=True))

    @property
    def test(self) -> int:
        """Rows of the test part."""
        return len(self.series.times) - self.train


ARMADILLO = "armadillo, all rows"
ARMADILLO_PUBLISHED = {
    "C_i": 18.946 * 86_400,
    "C_e": 169.597 * 86_400,
    "g_ie": 1 / 0.001984,
    "g_e_out": 1 / 0.017593,
}
"""What the published fit found (Ro .017593 and Ri .001984 K/W, Cw 169.597 and Ci 18.946 J/K/86400), as 2R2C."""


def cases(folder: Path) -> list[Case]:
    """The cases whose data lie in `folder`; ReplayError where there is none, or a file is not what it should be."""
    if not folder.is_dir():
        raise ReplayError(f"--data {folder}: there is no such folder; name the one that holds {', '.join(_READERS)}")
    found = [case for path, reader in _READERS.items() if (folder / path).exists() for case in reader(folder / path)]
    if not found:
        raise ReplayError(f"--data {folder}: it holds none of {', '.join(_READERS)}")
    return found


def _darkgreybox(path: Path) -> list[Case]:
    heat, indoor, outdoor = read_columns(path, "Ph", "Ti", "Ta")
    network = presets.network("titethria")
    for parameter in network.parameters:
        # A heating power of up to 158 kW: more building than the preset's box allows for.
        lower, upper = (1e6, 1e12) if parameter.unit == "J/K" else (10.0, 1e6)
        network = network.with_parameter(parameter.name, lower=lower, upper=upper, nominal=None)
    return [
        Case(
            "darkgreybox demo",
            "a large building, 792 h of heating power (taken to be kW), indoor and outdoor temperature; TiTeThRia on "
            "the first 672 h, tested on the last 120 h, the split of its authors",
            network,
            HOUR,
            unbroken_series(indoor, [outdoor, 1000.0 * heat], HOUR),
            672,
            0.1,
            Published("darkgreybox, TiTeThRia", train_rmse=0.3719, test_rmse=0.3383),
        )
    ]


def _armadillo(path: Path) -> list[Case]:
    outdoor, heat, indoor = (values[:-1] for values in read_columns(path, "T_ext", "P_hea", "T_int"))
    network, series = presets.network("tite"), unbroken_series(indoor, [outdoor, heat], 1800)
    published = Published(
        "pySIP, 2R2C by maximum likelihood",
        train_rmse=0.7434,
        train_mae=0.6579,
        caveat="of a maximum-likelihood fit, which does not aim at this error",
    )
    return [
        Case(
            ARMADILLO,
            "a test house, 232 half hours of heating power, indoor and outdoor temperature (the last row dropped, as "
            "published); 2R2C on all of them",
            network,
            1800,
            series,
            len(indoor),
            0.05,
            published,
        ),
        Case(
            "armadillo, last third held out",
            "the same, with a split of our own: learned from the first 155 rows, tested on the last 77",
            network,
            1800,
            series,
            155,
            0.05,
            Published("none for this split"),
        ),
    ]


def _flexhouse(path: Path) -> list[Case]:
    outdoor, sun, heat, indoor = read_columns(path, "Ta", "Ps", "Ph", "yTi")
    day = 86_400 // 300
    return [
        Case(
            "FlexHouse PRBS1",
            "a light-weight office heated by a pseudo-random binary sequence, 1691 x 5 min with sun; TiTeThTs on the "
            "first four days, tested on the rest, a split of our own",
            flexhouse_network(),
            300,
            unbroken_series(indoor, [outdoor, 1000.0 * heat, 1000.0 * sun], 300),
            4 * day,
            0.03,
            Published("Bacher and Madsen 2011, TiTeThTs: no open-loop figure"),
        )
    ]


_READERS: Mapping[str, Callable[[Path], list[Case]]] = {
    "darkgreybox_demo/demo_data.csv": _darkgreybox,
    "armadillo/armadillo_data_H2.csv": _armadillo,
    "flexhouse_prbs1/inputPRBS1.csv": _flexhouse,
}


def flexhouse_network() -> Network:
    """TiTeThTs of Bacher and Madsen (2011): interior, envelope, heater and a sensor that lags behind the air."""
    boxes = {
        "C_s": ("J/K", 1e3, 1e7),
        "C_i": ("J/K", 1e5, 1e8),
        "C_e": ("J/K", 1e6, 1e9),
        "C_h": ("J/K", 1e3, 1e7),
        "g_is": ("W/K", 1.0, 1e5),
        "g_ie": ("W/K", 10.0, 1e4),
        "g_e_out": ("W/K", 5.0, 5e3),
        "g_ih": ("W/K", 5.0, 1e4),
        "A_w": ("m2", 0.1, 30.0),
    }
    return Network(
        name="titethts",
        capacitances={f"T_{part}": f"C_{part}" for part in "sieh"},
        boundaries=("T_out",),
        conductances=(
            Conductance("g_is", ("T_i", "T_s")),
            Conductance("g_ie", ("T_i", "T_e")),
            Conductance("g_e_out", ("T_e", "T_out")),
            Conductance("g_ih", ("T_i", "T_h")),
        ),
        heat_inputs=(HeatInput("u_heat", "T_h"), HeatInput("I_sol", "T_i", Gain(parameter="A_w"), "W/m2")),
        parameters=tuple(Parameter(name, *box) for name, box in boxes.items()),
        measured=("T_s",),
        description="TiTeThTs: interior, envelope, heater, sensor",
    ).validate()


def unbroken_series(output: Array, inputs: list[Array], period: int) -> Series:
    """One segment every `period` s from the channels (K,) of one output and of the inputs, in the network's order."""
    starts = np.zeros(len(output), dtype=np.bool_)
    starts[0] = True
    return Series(period * np.arange(len(output)), output[:, None], np.column_stack(inputs), starts)


def read_columns(path: Path, *names: str) -> list[Array]:
    """The named columns (K,) of a published CSV file; ReplayError where it is not what it should be."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = list(csv.DictReader(file))
        table = [np.array([float(row[name]) for row in rows]) for name in names]
    except OSError as error:
        raise ReplayError(f"{path}: cannot be read ({error.strerror}); check its permissions") from error
    except KeyError as error:
        raise ReplayError(f"{path}: column {error} is missing; this is not the published file") from error
    except (ValueError, TypeError) as error:
        raise ReplayError(f"{path}: a cell is not a number ({error}); this is not the published file") from error
    if not rows or not all(np.isfinite(values).all() for values in table):
        raise ReplayError(f"{path}: it is empty or has gaps; this is not the published file")
    return table
