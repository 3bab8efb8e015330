"""`sensitivity`: what the settings of the particle filter do on the semi-synthetic building (5.1.5)."""

from collections.abc import Mapping

from replay.experiments.request import Request
from replay.experiments.study import Contender, Results, Study
from replay.lab.experiments.published import PUBLISHED
from replay.lab.experiments.semi_synthetic import building
from replay.lab.experiments.semi_synthetic.building import FILTERED, ONE_STEP, Ready, key
from replay.reports.kit.document import Document
from replay.reports.kit.report import Report
from replay.reports.kit.table import Table
from replay.simulated.semi_synthetic import MEASUREMENT_NOISE_SD

SEEDS = 2
PARTICLES = 9000
WINKLER = key(ONE_STEP, "Winkler, K")
COLUMNS = {
    "open-loop RMSE, K": "open loop, median",
    "one_step coverage": key(ONE_STEP, "coverage"),
    "one_step coverage, disturbed": key(ONE_STEP, "coverage", building.DOMINATED),
    "one_step Winkler, K": WINKLER,
    "filtered coverage": key(FILTERED, "coverage"),
    "filtered coverage, disturbed": key(FILTERED, "coverage", building.DOMINATED),
    "filtered width, K": key(FILTERED, "width, K"),
    **{name: name for name in (building.INDEX, building.AUC, "ms per sample")},
}


def changes(particles: int) -> dict[str, Mapping[str, object]]:
    """What is changed, beginning with nothing; particle counts are a third and 5/3 of `particles`, as in the paper."""
    return {
        "as it is": {"particles": particles},
        **{f"{count:,} particles": {"particles": count} for count in (particles // 3, particles * 5 // 3)},
        **{f"volatility_sd {text}": {"volatility_sd": float(text)} for text in (".05", ".2")},
        **{
            f"gate {low:g} to {high:g}": {"gate_low": low, "gate_high": high}
            for low, high in ((0.15, 0.5), (0.15, 0.9), (0.4, 0.9))
        },
        "measurement_sd halved": {"measurement_sd": MEASUREMENT_NOISE_SD / 2},
        "measurement_sd doubled": {"measurement_sd": MEASUREMENT_NOISE_SD * 2},
    }


def prepare(request: Request) -> Study:
    """The experiment for `request`; ReplayError where it cannot be made."""
    particles = request.particles or PARTICLES
    usual: Mapping[str, object] = {"particles": particles, **building.NOISE}

    bases: dict[str, tuple[Mapping[str, object], tuple[str, ...]]] = {
        "default": (usual, ()),
        "paper, 6 free": ({"preset": "paper", **usual}, building.HELD),
    }
    entered = {
        base: [Contender(label, "rbpf", {**options, **change}, held) for label, change in changes(particles).items()]
        for base, (options, held) in bases.items()
    }
    return building.study(request, SEEDS, entered, _report)


def _report(results: Results, ready: Ready) -> Report:
    document, lead, sections = Document(__package__, "sensitivity.md"), list[str](), []
    for base in results.recordings:
        winkler = {label: results.mean(base, label, WINKLER) for label in results.contenders}
        as_is = winkler["as it is"]
        far = max(winkler, key=lambda label: abs(winkler[label] - as_is))
        lead += document.lines("Lead", base=base, as_is=as_is, far=far, changed=winkler[far])
        rows = (
            (
                label,
                *(results.spread(base, label, figure) for figure in COLUMNS.values()),
                next((said for begin, said in PUBLISHED["sensitivity"].items() if label.startswith(begin)), None),
            )
            for label in results.contenders
        )
        name = base.split(",")[0]
        table = Table(f"sensitivity-{name}", ("changed", *COLUMNS, "paper"), tuple(rows))
        sections.append(document.section("Settings around '{base}'", table, base=base, name=name))
    done = document.section("What was done", weather=ready.weather)
    return Report(document.title, tuple(lead), (done, *sections))
