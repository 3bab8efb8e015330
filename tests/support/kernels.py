"""Compile the filters for every number of states that tests use, once: side by side, processes would each do so."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from service.daemon.process import prepare_process

USED = {"mkf": ("tite", "building-67"), "rbpf": ("tite", "titeth", "ecolar-6r4c", "building-67")}
"""Networks of two to five states; `make kernels` compiles the default estimator for three."""


def compiled(estimator: str, preset: str) -> None:
    """Have an estimator learn from a sample and look ahead."""
    import numpy as np

    from estimator.network.presets import network
    from estimator.registry import build

    net = network(preset)
    made = build(estimator, net, 300.0, {"particles": 50})
    outputs, inputs = np.full(len(net.measured), 20.0), np.zeros(len(net.inputs))
    state = made.start(1, outputs, inputs)
    for _ in range(2):
        state = made.update(made.predict(state, inputs), outputs).state
    made.unfold(made.issue(state, 32), np.tile(inputs, (2, 1))).moments()


if __name__ == "__main__":
    prepare_process()
    for name, presets in USED.items():
        for one in presets:
            compiled(name, one)
