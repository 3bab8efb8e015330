"""Distance between the input-output dynamics of two parameter vectors (paper 3.5.1)."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from estimator.arrays import Array
from estimator.network.assembly import assemble, topology
from estimator.network.discretise import discretise
from estimator.network.network import Network

FREQUENCIES = 512


class TransferErrors(NamedTuple):
    """Relative errors (32) of N parameter vectors, each (N, n_y, n_u): root-mean-square ("H2") and worst case."""

    h2: Array
    h_infinity: Array


def frequency_response(
    network: Network, theta: Array, period: float, points: int = FREQUENCIES
) -> npt.NDArray[np.complex128]:
    """G(e^(i Omega); theta) = H (e^(i Omega) I - A_d)^(-1) B_d of `theta` (n_theta, N), shape (N, points, n_y, n_u) [K
    per unit of the input], in equal steps of Omega to pi, the Nyquist frequency pi / `period` rad/s."""
    model = discretise(assemble(network, theta), period)
    shift = np.exp(1j * np.linspace(0.0, np.pi, points))
    resolvent = shift[None, :, None, None] * np.eye(len(network.nodes)) - model.transition[:, None]
    states = np.linalg.solve(
        resolvent, np.broadcast_to(model.input[:, None], (*resolvent.shape[:3], len(network.inputs)))
    )
    return np.asarray(states[:, :, topology(network).measured], dtype=np.complex128)


def transfer_errors(network: Network, theta: Array, truth: Array, period: float) -> TransferErrors:
    """Relative errors (29)-(32) of `theta` (n_theta, N) against `truth` (n_theta,), channel by channel."""
    reference = frequency_response(network, truth[:, None], period)[0]
    deviation = np.abs(frequency_response(network, theta, period) - reference)
    size = np.abs(reference)
    return TransferErrors(
        h2=np.sqrt(np.mean(deviation**2, axis=1) / np.mean(size**2, axis=0)),
        h_infinity=deviation.max(axis=1) / size.max(axis=0),
    )
