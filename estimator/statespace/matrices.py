"""State-space matrices of an estimator's draws, at a step that is several of its periods.

With inputs u that are held over a step, the states x, which are the temperatures [degC] and then the unmeasured gain
[W] if the estimator has one, and the outputs y,

    x' = A x + B u + w,    w ~ N(0, Q),        y = C x + v,    v ~ N(0, R).

After the measured inputs, u holds the known f of each term of the network; its columns of B are the response to heat
into the term's node times the draw's coefficient. A and B are the exact zero-order hold of the network (paper (5)-(6)).
Over one period the gain is switched off or stays, heats its node, and then decays; a longer step composes periods, so
that a simulation passes through the same values.
"""

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from estimator.arrays import Array
from estimator.network.assembly import assemble, topology
from estimator.network.discretise import discretise
from estimator.network.network import HeatInput, Network
from estimator.types import ModelDraws

_GAIN = "unmeasured gain"


class StateSpace(NamedTuple):
    """K models of n_x states, n_u inputs and n_y outputs, in degC and W. C is the same for all."""

    network: Network
    weights: Array
    """(K,)."""
    a: Array
    """(K, n_x, n_x)."""
    b: Array
    """(K, n_x, n_u + m)."""
    c: Array
    """(n_y, n_x)."""
    q: Array
    """(K, n_x, n_x): covariance of w."""
    r: Array
    """(K, n_y, n_y): covariance of v."""
    state: Array
    """(K, n_x): x at the beginning."""


def of_draws(draws: ModelDraws, period: float, periods: int) -> StateSpace:
    """The matrices of every draw over a step of `periods` sampling periods of `period` s each."""
    network, gains = draws.network, len(draws.gain_decay)
    states = len(network.nodes)
    transition, response, heat = _one_period(draws, period)
    count, size = len(transition), states + gains
    whole, drive = np.zeros((count, size, size)), np.zeros((count, size, response.shape[2]))
    whole[:, :states, :states], drive[:, :states] = transition, response
    if gains:
        whole[:, :states, states] = draws.gain_stays * heat
        whole[:, states, states] = draws.gain_stays * draws.gain_decay[0]
    noise = np.zeros((count, size, size))
    noise[:, np.arange(size), np.arange(size)] = draws.process_variance.T
    total, inputs, spread = whole, drive, noise
    for _ in range(periods - 1):
        total, inputs = whole @ total, whole @ inputs + drive
        spread = whole @ spread @ whole.transpose(0, 2, 1) + noise
    measured = topology(network).measured
    selection = np.zeros((len(measured), size))
    selection[np.arange(len(measured)), measured] = 1.0
    sensor = np.zeros((count, len(measured), len(measured)))
    sensor[:, np.arange(len(measured)), np.arange(len(measured))] = draws.measurement_variance.T
    return StateSpace(
        network=network,
        weights=draws.weights,
        a=total,
        b=inputs,
        c=selection,
        q=spread,
        r=sensor,
        state=draws.state.T,
    )


def of_point(draws: ModelDraws, period: float, periods: int) -> StateSpace:
    """The one model at the posterior mean: parameters, state, decay of the gain and noise, over the same step."""

    def mean(rows: Array) -> Array:
        return (rows * draws.weights).sum(axis=1, keepdims=True)

    point = draws._replace(
        weights=np.ones(1),
        theta=draws.point[:, None],
        state=draws.mean[:, None],
        spread=draws.spread[:, :1],
        gain_decay=mean(draws.gain_decay),
        process_variance=mean(draws.process_variance),
        measurement_variance=mean(draws.measurement_variance),
        coefficients=mean(draws.coefficients) if len(draws.coefficients) else draws.coefficients,
    )
    return of_draws(point, period, periods)


def _one_period(draws: ModelDraws, period: float) -> tuple[Array, Array, Array]:
    """A_d (K, n_x, n_x), B_d (K, n_x, n_u + m), and the response (K, n_x) [K/W] to heat into the first output."""
    exact = discretise(assemble(heated(draws.network), draws.theta), period)
    response = exact.input[:, :, :-1]
    if len(draws.coefficients):
        response[:, :, -len(draws.network.terms) :] *= draws.coefficients.T[:, None, :]
    return exact.transition, response, exact.input[:, :, -1]


@lru_cache(maxsize=1024)
def heated(network: Network) -> Network:
    """`network` with the heat of every term, and then the unmeasured gain, as inputs."""
    terms = tuple(HeatInput(term.name, term.node) for term in network.terms)
    return replace(network, heat_inputs=(*network.heat_inputs, *terms, HeatInput(_GAIN, network.measured[0])))
