"""What a reader gets of an experiment: tables in three forms, verdicts, one page that needs nothing else."""

from __future__ import annotations

import csv
import io
import math
import re
from pathlib import Path

import plotly.graph_objects as go
import pytest

from replay.errors import ReplayError
from replay.reports.kit.report import Plot, Report, Section, write_report
from replay.reports.kit.table import Spread, Table, number, spread
from replay.reports.kit.verdict import at_least, at_most, between, near, verdict_table, within

TABLE = Table(
    "scores",
    "Scores <of> all",
    ("estimator", "RMSE, K", "runs"),
    (("a | b", spread([1.0, 2.0, 3.0]), 3), ("paper", 0.088, None), ("<none>", math.nan, 0)),
    "A note.",
    quoted=1,
)


def test_a_spread_is_mean_and_sample_deviation() -> None:
    assert spread([1.0, 2.0, 3.0]) == Spread(2.0, 1.0)
    assert math.isnan(spread([4.0]).sd)
    assert str(spread([4.0])) == "4.00"
    assert str(Spread(0.0123, 0.00456)) == "0.0123 ± 0.0046"


@pytest.mark.parametrize(
    ("value", "shown"),
    [(0.0, "0.00"), (0.7719, "0.772"), (12.34, "12.3"), (22176.0, "22176"), (1.5e-5, "1.50e-05"), (math.nan, "–")],
)
def test_numbers_have_three_digits(value: float, shown: str) -> None:
    assert number(value) == shown


def test_csv_has_every_digit_and_a_column_for_deviations() -> None:
    rows = list(csv.reader(io.StringIO(TABLE.csv())))
    assert rows == [
        ["estimator", "RMSE, K", "RMSE, K (sd)", "runs"],
        ["a | b", "2.0", "1.0", "3"],
        ["paper", "0.088", "", ""],
        ["<none>", "", "", "0"],
    ]


def test_markdown_and_html_escape_what_would_break_them() -> None:
    assert r"| a \| b | 2.00 ± 1.00 | 3 |" in TABLE.markdown()
    assert TABLE.markdown().endswith("\n\nA note.\n")
    assert "Scores &lt;of&gt; all" in TABLE.html()
    assert TABLE.html().count("class='quoted'") == 1
    assert "<td class='text'>&lt;none&gt;</td>" in TABLE.html()


def test_a_row_of_another_length_is_refused() -> None:
    with pytest.raises(ValueError, match="a row of 1 cells under 2 columns"):
        Table("t", "T", ("a", "b"), ((1,),))


def test_verdicts_follow_the_mean_over_seeds() -> None:
    assert at_most("x", [0.9, 1.0], 0.95).met
    assert not at_most("x", [0.9, 1.01], 0.95).met
    assert at_least("x", [0.95], 0.95).met
    assert not at_least("x", [0.949], 0.95).met
    assert between("x", [0.9, 1.0], 0.945, 0.96).met
    assert not between("x", [0.97], 0.945, 0.96).met
    assert near("x", [1.04], 1.0, 0.05).met
    assert not near("x", [0.94], 1.0, 0.05).met
    assert within("x", [0.958], 0.949, 0.01).met
    assert not within("x", [0.938], 0.949, 0.01).met


def test_what_was_not_run_is_open_not_met() -> None:
    for values in ([], [math.nan, 1.0]):
        verdict = at_most("x", values, 2.0)
        assert verdict.met is None
        assert verdict_table([verdict]).rows[0][-2:] == ("open", None)


def test_a_missed_target_says_by_how_much() -> None:
    assert at_most("x", [1.2], 1.0).off == pytest.approx(0.2)
    assert near("x", [1.155], 1.0, 0.05).off == pytest.approx(0.1)
    assert verdict_table([at_least("x", [0.9], 1.0)]).rows[0][-2:] == ("missed", "10.0 %")
    assert at_most("x", [0.9], 1.0).off is None


def test_a_report_is_one_page_without_any_outside_address(tmp_path: Path) -> None:
    plot = Plot("A line", go.Figure(go.Scatter(x=[1, 2], y=[3, 4])), "It rises in `x`.")
    section = Section("First", ("Text with `code` & more.", "```\na = 1\n```"), (TABLE,), (plot,))
    written = write_report(Report("A <title>", ("Lead.",), (section,)), tmp_path / "out")
    assert [path.name for path in written] == ["report.html", "scores.csv", "scores.md"]
    page = written[0].read_text(encoding="utf-8")
    assert not re.search(r"<(?:script|link|img)[^>]*(?:src|href)=", page)
    assert page.count("<script>/**") == 1, "plotly.js once"
    body = page.split("</head>")[1]
    assert "Text with <code>code</code> &amp; more." in body
    assert "<pre>a = 1</pre>" in body
    assert "A &lt;title&gt;" in body


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ReplayError, match=r"--out .*file.*; choose another folder"):
        write_report(Report("T", (), ()), tmp_path / "file" / "out")
