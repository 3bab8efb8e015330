"""Every experiment in short: few particles, few days, from the command line to its report."""

import signal
import subprocess
import tomllib
from collections.abc import Sequence
from pathlib import Path

import pytest
from support.energyplus import needs_energyplus
from support.harness import INTERRUPTIBLE
from support.tables import rows_of
from support.waiting import wait_until

from service.cli.main import main

ROOT = Path(__file__).parents[4]
EXAMPLES = ROOT / "deploy" / "examples"
SHORT = ["--days", "2", "--particles", "60", "--seeds", "2", "--jobs", "2"]


def run(name: str, out: Path, *options: str, short: Sequence[str] = SHORT) -> Path:
    assert main(["experiment", name, "--out", str(out), *short, *options]) == 0
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "What was done" in page
    assert "nan" not in page.split("</head>")[1].replace("nanm", "").lower().split("<script")[0]
    return out


@pytest.fixture(scope="module")
def semi_synthetic(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run("semi-synthetic", tmp_path_factory.mktemp("semi"))


def test_semi_synthetic_has_every_contender_beside_the_floor_and_the_paper(semi_synthetic: Path) -> None:
    one_step, filtered = (
        {row["estimator"]: row for row in rows_of(semi_synthetic / f"calibration-{name}.csv")}
        for name in ("one-step", "filtered")
    )
    assert any(label.startswith("RBPF, authors' runs") for label in one_step)
    winkler = {label: float(row["Winkler, K"]) for label, row in one_step.items() if row["Winkler, K (sd)"]}
    floor = winkler.pop("floor: true parameters, gain known")
    assert 0.65 < floor < 0.9
    assert {"RBPF default, 10 free", "RBPF paper, 6 free", "EKF paper, 10 free", "UKF paper, 6 free"} <= set(winkler)
    assert all(floor < other for other in winkler.values())
    # No honest interval of y is narrower than the noise of y alone makes it; the filtered one leaves noise out.
    wide, narrow = (float(table["RBPF default, 10 free"]["width, K"]) for table in (one_step, filtered))
    assert wide > 2 * 1.95 * 0.15 > narrow
    targets = {row["target"]: row for row in rows_of(semi_synthetic / "verdicts.csv")}
    assert targets["RBPF default, 10 free: AUC of alpha"]["verdict"] in ("met", "missed")
    verdict = targets["floor: true parameters, gain known: one_step Winkler, K"]
    found = float(verdict["found (mean ± sd over seeds)"])
    assert verdict["verdict"] == ("met" if abs(found - 0.772) <= 0.00772 else "missed")
    errors = {row["estimator"]: row for row in rows_of(semi_synthetic / "transfer-function-errors.csv")}
    assert {"least squares, offline", "LS, paper (Table 4)"} <= set(errors)
    assert all(float(row["H2 solar"]) > 0 for row in errors.values())
    simulated = {row["estimator"] for row in rows_of(semi_synthetic / "open-loop.csv")}
    assert simulated >= {"Kalman filter, true parameters, gain ignored", "RBPF paper, 6 free"}


def test_an_experiment_that_is_finished_only_writes_its_report_again(semi_synthetic: Path) -> None:
    files = {path: path.stat().st_mtime_ns for path in (semi_synthetic / "runs").iterdir()}
    (semi_synthetic / "report.html").unlink()
    run("semi-synthetic", semi_synthetic)
    assert {path: path.stat().st_mtime_ns for path in (semi_synthetic / "runs").iterdir()} == files


def test_ecolar_compares_nights(tmp_path: Path) -> None:
    recording = ROOT / "deploy/examples/data/ecolar-standin.csv.gz"
    out = run("ecolar", tmp_path, "--data", str(recording), "--seeds", "1,")
    nights = {row["estimator"]: row for row in rows_of(out / "ecolar-nights.csv")}
    assert 0 < float(nights["RBPF default"]["median, final"]) < 5
    assert 0 < float(nights["RBPF default"]["median, evening"]) < 5
    assert 0 < float(nights["least squares, offline"]["median, final"]) < 2
    one_step, filtered = (rows_of(out / f"ecolar-calibration-{name}.csv") for name in ("one-step", "filtered"))
    assert all(
        float(a["width, K"]) > float(b["width, K"])
        for a, b in zip(one_step, filtered, strict=False)
        if a["width, K (sd)"]
    )


def test_sensitivity_changes_one_thing_at_a_time(tmp_path: Path) -> None:
    out = run("sensitivity", tmp_path, "--seeds", "1", "--particles", "150")
    for base in ("default", "paper"):
        table = {row["changed"]: row for row in rows_of(out / f"sensitivity-{base}.csv")}
        assert float(table["as it is"]["filtered width, K"]) < float(
            table["measurement_sd doubled"]["filtered width, K"]
        )
        assert {"50 particles", "250 particles", "volatility_sd .05", "gate 0.15 to 0.5"} <= set(table)


DAY = ["--days", "1", "--particles", "60", "--seeds", "4,", "--jobs", "2"]


@pytest.fixture(scope="module")
def day(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an experiment on a day without unmeasured heat."""
    return tmp_path_factory.mktemp("day")


def test_ctrl_c_keeps_what_is_finished_and_the_same_command_goes_on(day: Path) -> None:
    options = ["experiment", "semi-synthetic", *DAY, "--out", str(day)]
    with subprocess.Popen([*INTERRUPTIBLE, *options], stderr=subprocess.PIPE, text=True, cwd=ROOT) as process:
        wait_until(lambda: [*day.glob("runs/*.npz")], pause=0.02)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=180)
    kept = {path.name for path in (day / "runs").iterdir()}
    assert process.returncode == 130
    # What Python's own tracker of semaphores says of an interrupted start may follow.
    assert said.splitlines()[0].endswith("the same command goes on from there")
    assert "Traceback" not in said
    assert 1 <= len(kept) < 14
    assert all(name.endswith(".npz") for name in kept)
    assert main(options) == 0
    assert kept < {path.name for path in (day / "runs").iterdir()}


def test_a_day_without_unmeasured_heat_has_its_report(day: Path) -> None:
    out = run("semi-synthetic", day, short=DAY)
    targets = rows_of(out / "verdicts.csv")
    met, missed = (sum(row["verdict"] == word for row in targets) for word in ("met", "missed"))
    assert met + missed < len(targets)
    said = f"{met} of {len(targets)} are met, {missed} missed, {len(targets) - met - missed} open"
    assert said in (out / "report.html").read_text(encoding="utf-8")


MISTAKES = tomllib.loads(Path(__file__).with_name("mistakes.toml").read_text(encoding="utf-8"))["mistakes"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        pytest.param(row["options"], row["said"], marks=needs_energyplus if "energyplus" in row else ())
        for row in MISTAKES
    ],
)
def test_mistakes_are_one_sentence(
    options: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["experiment", *(word.replace("EXAMPLES", str(EXAMPLES)) for word in options)]) in (1, 2)
    complaint = capsys.readouterr().err
    assert said in complaint
    assert complaint.startswith("thermogate: ")
    assert complaint.count("\n") == 1
