"""The floor: a Kalman filter that knows what no estimator of real data can know, for simulated data only.

Its parameters are the truth, and a heat gain that other estimators are not told arrives as one more input channel. What
remains is the noise that nothing can predict, so its scores are the best that are to be had on that data.
"""

from collections.abc import Mapping
from dataclasses import replace

from estimator.gaussian.ekf import EKF
from estimator.gaussian.options import AugmentedOptions
from estimator.network.network import HeatInput, Network

GAIN_CHANNEL = "q_unmeasured"


def with_known_gain(network: Network, node: str, channel: str = GAIN_CHANNEL) -> Network:
    """`network` with the unmeasured gain [W] into `node` as its last input, `channel`."""
    return replace(network, heat_inputs=(*network.heat_inputs, HeatInput(channel, node))).validate()


def floor(
    network: Network,
    period: float,
    *,
    process_sd: float,
    measurement_sd: float,
    theta: Mapping[str, float] | None = None,
) -> EKF:
    """The Kalman filter of `network` with the parameters `theta`; those that it leaves out are nominal.

    `process_sd` [K per step] and `measurement_sd` [K] are those of the simulation. The gain is known if the network has
    it as an input (`with_known_gain`), ignored otherwise. Raises NetworkError where a parameter has no value.
    """
    for name, value in (theta or {}).items():
        network = network.with_parameter(name, nominal=float(value))
    known = network.with_fixed(parameter.name for parameter in network.parameters)
    return EKF(known, period, AugmentedOptions(process_sd=process_sd, measurement_sd=measurement_sd))
