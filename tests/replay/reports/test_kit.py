"""What a reader gets of an experiment: tables in three forms, verdicts, one page that needs nothing else."""

import csv
import io
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from support.tables import tabled

from replay.errors import ReplayError
from replay.reports.kit import verdict
from replay.reports.kit.chart import Chart, Line, Panel
from replay.reports.kit.document import Document
from replay.reports.kit.report import Plot, Report, Section, write_report
from replay.reports.kit.table import Spread, Table, number, spread
from replay.reports.kit.verdict import verdict_table

TABLE = Table(
    "scores",
    ("estimator", "RMSE, K", "runs"),
    (("a | b", spread([1.0, 2.0, 3.0]), 3), ("paper", 0.088, None), ("<none>", math.nan, 0)),
    "Scores <of> all",
    "A `note`.",
    quoted=1,
)


def test_a_spread_is_mean_and_sample_deviation():
    assert spread([1.0, 2.0, 3.0]) == Spread(2.0, 1.0)
    assert math.isnan(spread([4.0]).sd)
    assert str(spread([4.0])) == "4.00"
    assert str(Spread(0.0123, 0.00456)) == "0.0123 ± 0.0046"


@pytest.mark.parametrize(
    ("value", "shown"),
    [(0.0, "0.00"), (0.7719, "0.772"), (12.34, "12.3"), (22176.0, "22176"), (1.5e-5, "1.50e-05"), (math.nan, "–")],
)
def test_numbers_have_three_digits(value, shown):
    assert number(value) == shown


def test_csv_has_every_digit_and_a_column_for_deviations():
    assert list(csv.reader(io.StringIO(TABLE.csv()))) == [
        ["estimator", "RMSE, K", "RMSE, K (sd)", "runs"],
        ["a | b", "2.0", "1.0", "3"],
        ["paper", "0.088", "", ""],
        ["<none>", "", "", "0"],
    ]


def test_html_escapes_what_would_break_it():
    assert "Scores &lt;of&gt; all" in TABLE.html()
    assert TABLE.html().count("class='quoted'") == 1
    assert "<td class='text'>&lt;none&gt;</td>" in TABLE.html()
    assert "A <code>note</code>." in TABLE.html()


def test_code_is_marked_and_numbers_align_right_whatever_their_decimal_sign():
    page = Table("t", ("what", "share"), (("do `x`", "+7,5 %"), ("y", "–"))).html()
    assert "<td class='text'>do <code>x</code></td><td>+7,5 %</td>" in page


def test_a_row_of_another_length_is_refused():
    with pytest.raises(ValueError, match="a row of 1 cells under 2 columns"):
        Table("t", ("a", "b"), ((1,),))


@tabled
def test_verdicts_follow_the_mean_over_seeds(wanted, values, met, off):
    kind, *limits = wanted
    (row,) = verdict_table([getattr(verdict, kind)(*limits).judge("x", values)]).rows
    assert row[-2:] == ({True: "met", False: "missed", None: "open"}[met], off)


def test_a_report_is_one_page_without_any_outside_address(tmp_path):
    line = Line("T", "ink", np.array([1.0, 2.0]), np.array([3.0, 4.0]))
    plot = Plot("line", Chart([Panel([line])], "h"), title="A line", reading="It rises in `x`.")
    section = Section("First", ("Text with `code` & more.", "```\na = 1\n```"), (TABLE,), (plot,))
    written = write_report(Report("A <title>", ("Lead.",), (section,)), tmp_path / "out")
    assert [path.name for path in written] == ["report.html", "scores.csv"]
    page = written[0].read_text(encoding="utf-8")
    assert not re.search(r"<(?:script|link|img)[^>]*(?:src|href)=", page)
    assert len(page) < 10_000
    body = page.split("</head>")[1]
    assert "Text with <code>code</code> &amp; more." in body
    assert "<pre>a = 1</pre>" in body
    assert "A &lt;title&gt;" in body


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ReplayError, match=r"--out .*file.*; choose another folder"):
        write_report(Report("T", (), ()), tmp_path / "file" / "out")


def test_the_words_of_a_report_are_a_document_with_figures(tmp_path, monkeypatch):
    (tmp_path / "words").mkdir()
    (tmp_path / "words" / "__init__.py").write_text("")
    (tmp_path / "words" / "report.md").write_text(
        "# A title\n\n## {name}: first\n\nSaid over\ntwo lines of {name}.\n\n{nothing}\n\n"
        "[[scores]] All of {name}\nA\nnote.\n\n[[other]] None\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    document = Document("words")
    section = document.section("{name}: first", TABLE, None, name="x", nothing="")
    assert (document.title, section.title) == ("A title", "x: first")
    assert section.paragraphs == ("Said over two lines of x.",)
    assert [(table.name, table.title, table.note) for table in section.tables] == [("scores", "All of x", "A note.")]
    with pytest.raises(AssertionError, match="has no place for third"):
        document.section("{name}: first", replace(TABLE, name="third"), name="x", nothing="")
