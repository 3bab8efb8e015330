"""What a particle of the mixture Kalman filter is, and the model by which all of them move.

Every particle carries one Gaussian over z = [x, q, c, phi]: node temperatures [degC], the unmeasured heat gain [kW]
into the first measured node (left out where a filter has none), the coefficients of the network's terms (each in its
own unit; most networks have none), and the logarithms of the free parameters. Sampled, and so known to each particle
for certain, are the noise levels, whether the gain is on, and the gain's time constant.
"""

from typing import NamedTuple

import numpy as np

from estimator.arrays import DAY, HOUR, Array, Indices
from estimator.heat.terms import HABIT
from estimator.mixture.options import LEARNED, MKFOptions
from estimator.network.assembly import Topology, topology
from estimator.network.network import Network
from estimator.network.space import ParameterSpace, parameter_space
from estimator.particle.options import ALL_NODES

WATTS = 1000.0
"""Watts in the unit of q."""
SMALLEST_PIVOT = 1e-12
"""Share of a variance below which what is left of it, given the components before, is rounding."""

_PROPOSED_ONSETS = 0.1
"""Share of the particles without a gain that try one."""


class Particles(NamedTuple):
    """N particles of a filter with n_z = n_x + G + m + d Gaussian components, B volatility blocks and n_y outputs.

    G is 1 where there is a gain and 0 where there is none, m the number of terms of the network.
    """

    mean: Array
    """(n_z, N): means of temperatures [degC], gain [kW], coefficients and log parameters."""
    covariance: Array
    """(n_z (n_z + 1) / 2, N): packed lower triangles."""
    log_alpha: Array
    """(B, N)."""
    log_noise: Array
    """(n_y, N): log sigma_y [K]."""
    gain_on: Array
    """(G, N): 1 while the gain is on, else 0."""
    log_hours: Array
    """(G, N): log of the gain's time constant [h]."""


class Walk(NamedTuple):
    """The draws with which sampled quantities move over a step."""

    normals: Array
    """(2 B + n_y + G, N): steps of log alpha, sizes of its jumps, steps of log sigma_y, of the log time constant."""
    uniforms: Array
    """(B + 2 G, N): whether log alpha jumps, whether the gain switches, the size of a new one."""


class Scenarios(NamedTuple):
    """K sampled starts of a forecast, and where the draws of the filter stand."""

    seed: Array
    step: Array
    """(): as in the filter's state."""
    state: Array
    """(n_z, K): draws of z."""
    log_alpha: Array
    log_noise: Array
    gain_on: Array
    log_hours: Array
    """As in `Particles`."""


class MixtureModel:
    """Network and options as the numbers that both implementations of the filter take."""

    def __init__(self, network: Network, period: float, options: MKFOptions) -> None:
        """`network` is validated, `period` in s."""
        self.network, self.period, self.options = network, float(period), options
        self.topology: Topology = topology(network)
        self.space: ParameterSpace = parameter_space(network, logit=False)
        blocks = options.volatility_blocks or {ALL_NODES: network.nodes}
        self.blocks: tuple[str, ...] = () if options.volatility == "none" else tuple(blocks)
        owner = {node: index for index, nodes in enumerate(blocks.values()) for node in nodes}
        self.block: Indices = np.array([owner[node] for node in network.nodes], dtype=np.int64)
        self.states = len(network.nodes)
        self.gains = 0 if options.gain == "none" else 1
        self.free = len(self.space.free)
        terms = network.terms
        self.terms = len(terms)
        self.size = self.states + self.gains + self.terms + self.free
        heated = tuple(dict.fromkeys(term.node for term in terms))
        self.heated: Indices = np.array([network.nodes.index(node) for node in heated], dtype=np.int64)
        """(D,): states that terms heat."""
        self.term_place: Indices = np.array([heated.index(term.node) for term in terms], dtype=np.int64)
        """(m,): place of each term's node in `heated`."""
        self.habits = np.array(
            [term.series.startswith(HABIT) and term.node == network.measured[0] for term in terms], dtype=np.bool_
        )
        """(m,): whether a term is heat into the first measured node that nobody measures."""
        self.coefficient_mean: Array = np.array([term.mean for term in terms], dtype=np.float64)
        """(m,): of the prior of c."""
        self.coefficient_walk: Array = np.array([term.walk**2 * period / DAY for term in terms], dtype=np.float64)
        """(m,): variance of the walk of c over a step."""
        self.lower: Array = np.concatenate([[-np.inf if t.lower is None else t.lower for t in terms], self.space.lower])
        self.upper: Array = np.concatenate([np.full(self.terms, np.inf), self.space.upper])
        """(m + d,): bounds of c and phi."""
        self.outputs = len(network.measured)
        self.learns_noise = options.measurement_sd == LEARNED

    @property
    def samples_nothing(self) -> bool:
        """Whether particles differ in nothing but their Gaussians, and so never part once they are equal."""
        options = self.options
        guesses = options.gain_decays and options.gain_hours_min < options.gain_hours_max
        switches = options.gain == "switching" or (options.gain == "always" and guesses)
        return not (self.blocks or switches or self.learns_noise)

    @property
    def proposed_on_probability(self) -> float:
        """Probability with which particles try a new gain; more than its own, which weights make good.

        A gain begins rarely, and of a few hundred particles one or two would know of it.
        """
        return max(self.on_probability, _PROPOSED_ONSETS) if self.on_probability > 0.0 else 0.0

    @property
    def on_probability(self) -> float:
        """Probability per step that a gain begins."""
        return self.options.gain_on_probability if self.options.gain == "switching" else 0.0

    @property
    def off_probability(self) -> float:
        """Probability per step that a gain ends."""
        return self.options.gain_off_probability if self.options.gain == "switching" else 0.0

    @property
    def gain_node(self) -> int:
        """The state that the gain heats."""
        return int(self.topology.measured[0])

    @property
    def news(self) -> float:
        """Share of an update that log parameters take."""
        lasting = self.options.error_hours * HOUR
        return min(self.period / lasting, 1.0) if lasting > 0.0 else 1.0

    @property
    def coefficients(self) -> slice:
        """The rows of c in z."""
        return slice(self.states + self.gains, self.states + self.gains + self.terms)

    @property
    def prior_variance(self) -> Array:
        """(m + d,): variances of the prior of c and of phi."""
        own = np.array([term.sd**2 for term in self.network.terms], dtype=np.float64)
        return np.concatenate([own, self.space.prior_variance])

    @property
    def noise_bounds(self) -> tuple[float, float]:
        """Bounds of log sigma_y; both the same where it is given."""
        options = self.options
        if isinstance(options.measurement_sd, str):
            return float(np.log(options.measurement_sd_min)), float(np.log(options.measurement_sd_max))
        return (float(np.log(options.measurement_sd)),) * 2

    @property
    def hour_bounds(self) -> tuple[float, float]:
        """Bounds of the log of the gain's time constant [h]."""
        return float(np.log(self.options.gain_hours_min)), float(np.log(self.options.gain_hours_max))

    @property
    def gain_sd_bounds(self) -> tuple[float, float]:
        """Bounds of the log of a new gain's standard deviation [kW]."""
        return float(np.log(self.options.gain_sd_min)), float(np.log(self.options.gain_sd_max))

    @property
    def walk_shapes(self) -> tuple[int, int]:
        """Rows of `Walk.normals` and `Walk.uniforms`."""
        blocks = len(self.blocks)
        return 2 * blocks + self.outputs + self.gains, blocks + 2 * self.gains

    @property
    def scenario_shapes(self) -> tuple[int, int]:
        """Rows of normals and of uniforms that a step of a scenario takes.

        Normals: process noise of every state, steps of log alpha, sizes of its jumps, a new gain, the gain's walk.
        Uniforms: as `Walk.uniforms`.
        """
        blocks = len(self.blocks)
        return self.states + 2 * blocks + 2 * self.gains, blocks + 2 * self.gains
