"""What a zone begins with where other zones of its site have learned already: empirical Bayes, estimator by estimator.

- Log parameters and coefficients: each is drawn from a population of rooms, of which the neighbours are a sample. Mean
  and spread of that population follow from their posteriors by expectation maximisation, as far as these are narrower
  than the prior. All count from the middle of their prior in its standard deviations, so that floor areas cancel out
  where they are known.
- Regressions: sums of the neighbours, as if the zone had seen some days of each of them.
- Bank: costs of the members and widths, as if it had verified some days.

Nothing is taken as certain. A spread is never narrower than _NARROWEST of the prior's, and all that counts in samples
counts as DAYS of one's own, so that a room which is unlike its neighbours has soon forgotten them.

An experience is arrays by name. It is made for one estimator of one network, and belongs into that zone's checkpoints.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from estimator.arrays import DAY, Array, together, under
from estimator.bank.bank import Bank, BankState
from estimator.bank.weights import Costs
from estimator.blackbox.arx import ARX, ARXState
from estimator.blackbox.daily import Daily, DailyState
from estimator.blackbox.direct import CLOCK, Direct
from estimator.gaussian.augmented import AugmentedFilter
from estimator.gaussian.square_root import Gaussian
from estimator.kernels.packing import packed
from estimator.mixture.mkf import MKF, MKFState
from estimator.network.network import Network
from estimator.network.space import parameter_space
from estimator.types import Estimator

Experience = Mapping[str, Array]

DAYS = 3.0
"""Days of its own that a zone takes the sums of its neighbours for."""

_NARROWEST = 0.5
"""Standard deviation at least, as a share of the prior's."""
_BELIEVED, _SPREAD = 4.0, 0.5
"""A population is thought to have this spread, in standard deviations of the prior, by as many rooms."""
_SUREST = 0.05
"""Standard deviation below which no posterior is believed, in the same unit."""
_ROUNDS = 20


class Learned(NamedTuple):
    """What a zone has learned: an estimator, a state of it, and the time [UTC s] of that state."""

    estimator: Estimator
    state: Any
    time: float


def experience(estimator: Estimator, others: Sequence[Learned]) -> dict[str, Array]:
    """What `estimator`, which has seen nothing, can begin with after `others`; nothing where they are of other kinds.

    Regressions and banks count where channels, period and members are the same, parameters and coefficients by name.
    """
    found: dict[str, Array] = {}
    if isinstance(estimator, Bank):
        alike = [other for other in others if _same_bank(estimator, other.estimator)]
        if alike:
            found |= _proved([other.state for other in alike])
        for place, (name, member) in enumerate(zip(estimator.names, estimator.members, strict=True)):
            theirs = [each for other in others if (each := _member(other, name)) is not None]
            found |= {f"member.{place}.{key}": value for key, value in experience(member, theirs).items()}
    elif isinstance(estimator, MKF | AugmentedFilter):
        physical = [other for other in others if isinstance(other.estimator, MKF | AugmentedFilter)]
        found |= _population(estimator.network, physical)
    else:
        alike = [other for other in others if _same_regression(estimator, other.estimator)]
        if alike and isinstance(estimator, Direct):
            found |= _direct_sums(estimator, alike)
        elif alike and isinstance(estimator, ARX | Daily):
            found |= _arx_sums(estimator, [other.state for other in alike])
    return found


def begun(estimator: Estimator, state: Any, time: float, known: Experience | None) -> Any:
    """The first `state` of `estimator`, at `time` [UTC s], with what is `known` from its neighbours, if anything is."""
    if not known:
        return state
    if isinstance(estimator, Bank):
        return _begun_bank(estimator, state, time, known)
    if isinstance(estimator, MKF):
        return _begun_mixture(estimator, state, known)
    if isinstance(estimator, AugmentedFilter):
        return _begun_gaussian(estimator, state, known)
    if isinstance(estimator, Direct):
        # It fits with the first sample.
        fitted = np.array(round(DAY / estimator.period), dtype=np.int64)
        return state._replace(**{**known, "moments": _turned(known["moments"], -time), "fitted": fitted})
    return _begun_arx(state, known)


def _member(other: Learned, name: str) -> Learned | None:
    """The member `name` of another bank; None without one."""
    bank = other.estimator
    if not isinstance(bank, Bank) or name not in bank.names:
        return None
    place = bank.names.index(name)
    return other._replace(estimator=bank.members[place], state=other.state.members[place])


# Parameters and coefficients.


def _scales(network: Network) -> dict[str, tuple[float, float]]:
    """Centre and standard deviation of the prior of each coefficient and log parameter, by name."""
    space = parameter_space(network, logit=False)
    centres, sds = space.from_uniform(np.full((len(space.free), 1), 0.5))[:, 0], np.sqrt(space.prior_variance)
    found = {f"c.{term.name}": (term.mean, term.sd) for term in network.terms}
    names = [parameter.name for parameter in network.free]
    scales = zip(centres.tolist(), sds.tolist(), strict=True)
    return found | {f"phi.{name}": scale for name, scale in zip(names, scales, strict=True)}


def _posterior(other: Learned) -> tuple[Array, Array]:
    """Means and variances (m + d,) of coefficients and log parameters, in the order of `_scales`."""
    state, network = other.state, other.estimator.network
    rows, size = len(network.free) + len(network.terms), len(state.mean)
    if isinstance(state, Gaussian):
        return state.mean[size - rows :], (state.root[size - rows :] ** 2).sum(axis=1)
    weights, means = np.exp(state.log_weights), state.mean[size - rows :]
    variances = np.array([state.covariance[packed(row, row)] for row in range(size - rows, size)])
    mean = (means * weights).sum(axis=1)
    return mean, ((variances + (means - mean[:, None]) ** 2) * weights).sum(axis=1)


def _population(network: Network, others: Sequence[Learned]) -> dict[str, Array]:
    """Mean and standard deviation of each coefficient and log parameter of `network` among rooms like the `others`."""
    theirs: dict[str, list[tuple[float, float]]] = {}
    for other in others:
        scales, posterior = _scales(other.estimator.network), _posterior(other)
        for (name, (centre, sd)), mean, variance in zip(scales.items(), *posterior, strict=True):
            theirs.setdefault(name, []).append(((mean - centre) / sd, variance / sd**2))
    own = _scales(network)
    if not own or not theirs:
        return {}
    moved, spread = np.array([_predicted(theirs.get(name, [])) for name in own]).T
    centres, sds = np.array(list(own.values())).T
    return {"mean": centres + sds * moved, "sd": sds * spread}


def _predicted(posteriors: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Mean and standard deviation of the next room's value, in units of a prior N(0, 1), from those of others."""
    # What the prior has brought into a posterior is taken out again: only what was measured may count twice.
    sure = [(mean, max(variance, _SUREST**2)) for mean, variance in posteriors if variance < 1.0]
    seen = [(mean / variance / (1.0 / variance - 1.0), 1.0 / variance - 1.0) for mean, variance in sure]
    if not seen:
        return 0.0, 1.0
    values, precisions = (np.array(rows) for rows in zip(*seen, strict=True))
    middle, width, spread = 0.0, 1.0, _SPREAD**2
    for _ in range(_ROUNDS):
        weights = 1.0 / (spread + 1.0 / precisions)
        width = 1.0 / (1.0 + weights.sum())
        middle = width * float((weights * values).sum())
        share = spread * weights
        rooms = (share * (values - middle)) ** 2 + share / precisions + (1.0 - share) ** 2 * width
        spread = (_BELIEVED * _SPREAD**2 + float(rooms.sum())) / (_BELIEVED + len(values))
    return middle, float(np.sqrt(np.clip(spread + width, _NARROWEST**2, 1.0)))


def _begun_gaussian(estimator: AugmentedFilter, state: Gaussian, known: Experience) -> Gaussian:
    network, space = estimator.network, parameter_space(estimator.network, logit=False)
    free, mean, root = len(network.free), state.mean.copy(), state.root.copy()
    centres, sds = np.array(list(_scales(network).values())).T
    mean[-free:] = np.clip(known["mean"] + known["sd"] / sds * (mean[-free:] - centres), space.lower, space.upper)
    root[-free:, -free:] = np.diag(known["sd"])
    return Gaussian(mean, root)


def _begun_mixture(estimator: MKF, state: MKFState, known: Experience) -> MKFState:
    """Centres and Gaussians of all particles moved and narrowed as the prior was."""
    network, space = estimator.network, parameter_space(estimator.network, logit=False)
    terms, size = network.terms, len(state.mean)
    mean, covariance = state.mean.copy(), state.covariance.copy()
    centres, sds = np.array(list(_scales(network).values())).T
    shrunk = known["sd"] / sds
    lowest = [-np.inf if term.lower is None else term.lower for term in terms]
    lower, upper = np.concatenate([lowest, space.lower]), np.concatenate([np.full(len(terms), np.inf), space.upper])
    rows = slice(size - len(centres), size)
    moved = known["mean"][:, None] + shrunk[:, None] * (mean[rows] - centres[:, None])
    mean[rows] = np.clip(moved, lower[:, None], upper[:, None])
    for place, row in enumerate(range(rows.start, size)):
        covariance[packed(row, row)] *= shrunk[place] ** 2
    return state._replace(mean=mean, covariance=covariance)


# Regressions.


def _same_regression(one: Estimator, other: Estimator) -> bool:
    if not (isinstance(one, ARX | Daily | Direct) and isinstance(other, type(one)) and one.options == other.options):
        return False
    ours, theirs = one.network, other.network
    return (one.period, ours.inputs, ours.measured) == (other.period, theirs.inputs, theirs.measured)


def _shares(counts: Array, most: float) -> Array:
    """(n, ...): what to take of each of n sums over `counts` (n, ...) samples, of which `most` together count."""
    whole = counts.sum(axis=0)
    return np.broadcast_to(np.minimum(1.0, most / np.maximum(whole, 1e-12)), counts.shape)


def _direct_sums(estimator: Direct, others: Sequence[Learned]) -> dict[str, Array]:
    """Moments, with the hour as if every zone had begun at midnight UTC, and what verified forecasts were worth."""
    most = DAYS * DAY / estimator.period
    begins = [other.time - int(other.state.step) * estimator.period for other in others]
    turned = [_turned(other.state.moments, begin) for other, begin in zip(others, begins, strict=True)]
    moments, verified = np.stack(turned), np.stack([other.state.verified for other in others])
    return {
        "moments": (_shares(moments[..., 0, 0], most)[..., None, None] * moments).sum(axis=0),
        "verified": (_shares(verified[..., 0], most)[..., None] * verified).sum(axis=0),
        "seen": np.mean([other.state.seen for other in others], axis=0),
    }


def _turned(moments: Array, seconds: float) -> Array:
    """`moments` (n_y, L, p, p + 1) with a clock that shows so many `seconds` more."""
    angle = 2.0 * np.pi * seconds / DAY
    sine, cosine = np.sin(angle), np.cos(angle)
    turn = np.array([[cosine, sine], [-sine, cosine]])
    rows = moments.copy()
    rows[..., CLOCK, :] = np.einsum("ab,...bc->...ac", turn, rows[..., CLOCK, :])
    rows[..., CLOCK] = np.einsum("ab,...cb->...ca", turn, rows[..., CLOCK])
    return rows


def _arx_sums(estimator: ARX | Daily, states: Sequence[ARXState | DailyState]) -> dict[str, Array]:
    """Information matrices added up, and what follows from them without a prior."""
    most = DAYS * DAY / estimator.period
    information = np.stack([np.linalg.inv(state.covariance) for state in states])
    shares = _shares(information[..., 0, 0], most)[..., None, None]
    right = information @ np.stack([state.coefficients for state in states])[..., None]
    residual = np.stack([state.residual for state in states])
    found = {
        "information": (shares * information).sum(axis=0),
        "right": (shares * right).sum(axis=0),
        "residual": (_shares(residual[..., 1], most)[..., None] * residual).sum(axis=0),
    }
    if all(np.array_equal(state.leads, states[0].leads) for state in states):
        errors = np.stack([state.errors for state in states])
        kept = _shares(errors[..., 1], 24.0 * DAYS)[..., None]
        found |= {"leads": states[0].leads, "errors": (kept * errors).sum(axis=0)}
    return found


def _begun_arx(state: Any, known: Experience) -> Any:
    """The sums of the neighbours beside the prior."""
    prior = np.linalg.inv(state.covariance)
    whole = prior + known["information"]
    covariance = np.linalg.inv(whole)
    coefficients = np.linalg.solve(whole, prior @ state.coefficients[..., None] + known["right"])[..., 0]
    kept = {name: known[name] for name in ("leads", "errors") if name in known}
    return state._replace(
        coefficients=coefficients,
        covariance=0.5 * (covariance + covariance.swapaxes(-1, -2)),
        residual=state.residual + known["residual"],
        **kept,
    )


# The bank.


def _same_bank(one: Bank, other: Estimator) -> bool:
    return isinstance(other, Bank) and one.names == other.names and one.leads == other.leads


def _proved(states: Sequence[BankState]) -> dict[str, Array]:
    counts = np.stack([state.widths.verified for state in states])
    scales = np.stack([state.widths.log_scale for state in states])
    means = (counts * scales).sum(axis=0) / np.maximum(counts.sum(axis=0), 1e-12)
    return {
        "widths.log_scale": means,
        "widths.verified": np.minimum(counts.mean(axis=0), 24.0 * DAYS),
        **together({part + ".": _costs([getattr(state, part) for state in states]) for part in ("costs", "answers")}),
    }


def _costs(each: Sequence[Costs]) -> dict[str, Array]:
    hours = np.stack([one.hours for one in each])
    shares = _shares(hours, 24.0 * DAYS)
    return {
        "excess": (shares[:, None] * np.stack([one.excess for one in each])).sum(axis=0),
        "whole": (shares * np.stack([one.whole for one in each])).sum(axis=0),
        "hours": (shares * hours).sum(axis=0),
    }


def _begun_bank(bank: Bank, state: BankState, time: float, known: Experience) -> BankState:
    return state._replace(
        members=tuple(
            begun(member, own, time, under(f"member.{place}.", known))
            for place, (member, own) in enumerate(zip(bank.members, state.members, strict=True))
        ),
        costs=state.costs._replace(**under("costs.", known)),
        answers=state.answers._replace(**(under("answers.", known) or under("costs.", known))),
        widths=state.widths._replace(**under("widths.", known)),
    )
