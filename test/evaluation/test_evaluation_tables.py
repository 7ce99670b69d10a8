"""Tables: means as the paper has them, the best in bold, and what is missing left out."""

from __future__ import annotations

import csv
import dataclasses
import io
import math
import re
from statistics import stdev

import pytest

from etd_ros.evaluation import table_formats
from etd_ros.evaluation.cell_run import failed_cell
from etd_ros.evaluation.cells import Cell, CellResult
from etd_ros.evaluation.paper_figures import METHODS, printed
from etd_ros.evaluation.tables import MEAN, make_table

SHAPES, OTHER = ("ecd", "shapes_6dof"), ("folder", "desk_1")


def cell(system: str, place: tuple[str, str] = SHAPES, target: str = "a", repetition: int = 0) -> Cell:
    return Cell(*place, target, system, "one-pass", repetition)


def brought(of: Cell, ap: float, ar: float) -> CellResult:
    return CellResult(of, ap, ar, [1], [ap], [0.0], 0, [], 10, 2000, 0.05)


RESULTS = [
    brought(cell("kcf"), 0.2, 0.4), brought(cell("kcf", target="b"), 0.4, 0.6), brought(cell("kcf", OTHER), 0.9, 1.0),
    brought(cell("tld"), 0.1, 0.2), brought(cell("tld", target="b"), 0.3, 0.2),
    brought(cell("tld", OTHER), 0.9004, 0.5),
    brought(cell("tld", repetition=1), 0.5, 0.6), brought(cell("tld", target="b", repetition=1), 0.7, 0.8),
    brought(cell("eco"), 0.9, 0.9), failed_cell(cell("eco", target="b"), "it broke"),
    brought(cell("eco", OTHER), 0.1, 0.1),
]  # fmt: skip
SYSTEMS = ("tld", "kcf", "eco", "e-ms")


def table():
    return make_table(RESULTS, "one-pass", SYSTEMS)


def test_figures_are_means_over_targets_and_repetitions_with_the_spread_of_the_latter():
    rows = table().rows
    assert rows["kcf"][SHAPES].ap.mean == pytest.approx(0.3)
    assert rows["kcf"][SHAPES].ar.mean == pytest.approx(0.5)
    assert rows["kcf"][SHAPES].ap.spread is None
    assert rows["tld"][SHAPES].ap.mean == pytest.approx(0.4)
    assert rows["tld"][SHAPES].ap.spread == pytest.approx(stdev([0.2, 0.6]))


def test_a_sequence_with_an_error_has_no_figure_and_its_system_no_mean():
    found = table()
    assert SHAPES not in found.rows["eco"]
    assert found.rows["eco"][OTHER].ap.mean == 0.1
    assert found.rows["e-ms"] == {}
    assert list(found.means) == ["tld", "kcf"]
    assert found.means["kcf"].ap.mean == pytest.approx((0.3 + 0.9) / 2)
    assert found.entry("kcf", MEAN) == found.means["kcf"]
    assert found.entry("eco", MEAN) is None


def test_the_mean_over_sequences_has_the_spread_of_whole_repetitions():
    other = dataclasses.replace(RESULTS[5], cell=cell("tld", OTHER, repetition=1), ap=0.1)
    means = make_table([*RESULTS, other], "one-pass", SYSTEMS).means
    assert means["tld"].ap.mean == pytest.approx((0.4 + (0.9004 + 0.1) / 2) / 2)
    assert means["tld"].ap.spread == pytest.approx(stdev([(0.2 + 0.9004) / 2, (0.6 + 0.1) / 2]))
    assert means["kcf"].ap.spread is None
    assert table().means["tld"].ap.mean == pytest.approx((0.2 + 0.9004) / 2), "of the repetition that both have"


def test_a_sequence_on_which_every_system_failed_does_not_count_for_the_means():
    damaged = [failed_cell(cell(system, ("folder", "damaged")), "it is cut") for system in ("kcf", "tld")]
    found = make_table([*RESULTS, *damaged], "one-pass", SYSTEMS)
    assert ("folder", "damaged") in found.columns
    assert found.means == table().means


def test_failures_are_those_of_all_targets_in_the_mean_over_repetitions():
    def failed_labels(number: int, of: Cell) -> CellResult:
        return dataclasses.replace(brought(dataclasses.replace(of, protocol="restarts"), 0.5, 0.5), failures=number)

    results = [
        failed_labels(3, cell("tld")), failed_labels(1, cell("tld", OTHER)),
        failed_labels(2, cell("tld", repetition=1)), failed_labels(0, cell("tld", OTHER, repetition=1)),
        failed_labels(7, cell("kcf")),
    ]  # fmt: skip
    found = make_table(results, "restarts", SYSTEMS)
    assert (found.failures["tld"].mean, found.failures["kcf"].mean) == (3.0, 7.0)
    assert found.failures["tld"].spread == pytest.approx(stdev([4, 2]))
    text = table_formats.markdown(found)
    assert "restarts failures" in text.splitlines()[0]
    assert "| 3 ± 1.4 |" in text
    assert "failures" not in table_formats.markdown(table())


def test_results_of_other_protocols_and_systems_are_passed_over():
    other = dataclasses.replace(cell("kcf"), protocol="restarts")
    found = make_table([*RESULTS, brought(other, 1.0, 1.0)], "one-pass", ("kcf",))
    assert list(found.rows) == ["kcf"]
    assert found.rows["kcf"][SHAPES].ap.mean == pytest.approx(0.3)
    assert make_table([brought(other, 1.0, 1.0)], "one-pass", ("kcf",)).columns == []


def test_speed_is_over_all_cells_that_brought_a_result():
    speeds = table().speeds
    assert speeds["eco"].frame_ms == pytest.approx(5.0)
    assert speeds["kcf"].events_per_s == pytest.approx(40_000)
    assert math.isnan(speeds["e-ms"].frame_ms)


def test_markdown_has_the_best_in_bold_and_equal_ones_alike():
    lines = table_formats.markdown(table()).splitlines()
    rows = {line.split("|")[1].strip(): [part.strip() for part in line.split("|")[2:-1]] for line in lines}
    assert rows["system"] == [
        "ecd/shapes_6dof AP", "ecd/shapes_6dof AR", "paper AP", "paper AR", "folder/desk_1 AP", "folder/desk_1 AR",
        "mean AP", "mean AR", "time ms/frame", "time frames/s", "time Mev/s",
    ]  # fmt: skip
    assert rows["tld"][:4] == ["**0.400** ± 0.283", "0.450 ± 0.354", "0.430", "0.424"]
    assert rows["kcf"] == [
        "0.300", "**0.500**", "0.307", "0.430", "**0.900**", "**1.000**", "**0.600**", "**0.750**", "5.00",
        "200", "0.04",
    ]  # fmt: skip
    assert rows["tld"][4] == "**0.900**"
    assert rows["eco"][:2] == ["–", "–"]
    assert rows["e-ms"][:4] == ["–", "–", "0.612", "0.668"]
    assert len({line.count("|") for line in lines}) == 1


def test_latex_has_as_many_columns_in_each_row_as_it_declares():
    text = table_formats.latex(table())
    for page in text.split("\n\n"):
        declared = re.search(r"\\begin\{tabular\}\{\|((?:c\|)+)\}", page).group(1).count("c")
        rows = [line for line in page.splitlines() if line.endswith(r"\hline") or r"\cline" in line if "&" in line]
        assert len(rows) == len(SYSTEMS) + 2
        for row in rows:
            spans = [int(span) for span in re.findall(r"\\multicolumn\{(\d+)\}", row)]
            assert row.count("&") + 1 + sum(span - 1 for span in spans) == declared
        assert rf"\cline{{2-{declared}}}" in page
        assert [line.split(" & ")[0] for line in rows[2:]] == ["TLD", "KCF", "ECO", "E-MS"]
    assert text.count("{") == text.count("}")
    assert r"ecd/shapes\_6dof" in text
    assert r"\textbf{0.400} $\pm$ 0.283" in text
    assert "–" not in text


def test_latex_has_four_of_the_papers_sequences_in_a_table_or_two_beside_its_figures(monkeypatch):
    sequences = ("shapes_translation", "shapes_6dof", "poster_6dof", "slider_depth")
    results = [brought(cell("kcf", ("ecd", name)), 0.5, 0.6) for name in sequences]
    found = make_table(results, "one-pass", ("kcf",))

    def titles() -> list[list[str]]:
        pages = table_formats.latex(found).split("\n\n")
        return [re.findall(r"\\multicolumn\{\d+\}\{c\|\}\{([^}]*)\}", page.replace(r"\_", "_")) for page in pages]

    assert titles() == [
        ["shapes_translation", "paper", "shapes_6dof", "paper"],
        ["poster_6dof", "paper", "slider_depth", "paper"],
        ["mean", "time"],
    ]
    monkeypatch.setattr(type(found), "printed", lambda *_: {})
    assert titles() == [list(sequences), ["mean", "time"]]


def test_csv_has_unrounded_figures_and_the_papers():
    rows = list(csv.DictReader(io.StringIO(table_formats.csv_text(table()))))
    by_place = {(row["system"], row["sequence"]): row for row in rows}
    assert float(by_place["tld", "shapes_6dof"]["ap_spread"]) == pytest.approx(stdev([0.2, 0.6]))
    assert by_place["tld", "desk_1"]["ap"] == "0.9004"
    assert (by_place["kcf", "shapes_6dof"]["paper_ap"], by_place["kcf", "desk_1"]["paper_ap"]) == ("0.307", "")
    assert by_place["eco", "mean"]["ap"] == ""
    assert float(by_place["kcf", "mean"]["events_per_s"]) == pytest.approx(40_000)
    assert by_place["e-ms", "mean"]["ms_per_frame"] == ""


def test_html_escapes_names():
    result = brought(cell("kcf", ("folder", "<b>&")), 0.5, 0.5)
    assert '<th colspan="2">&lt;b&gt;&amp;</th>' in table_formats.html(make_table([result], "one-pass", ("kcf",)))


def test_special_characters_of_names_are_escaped():
    name = r"we|ird_~^\name<$>"
    found = make_table([brought(cell("kcf", ("folder", name)), 0.5, 0.5)], "one-pass", ("kcf",))
    assert (
        r"{we\textbar{}ird\_\textasciitilde{}\textasciicircum{}\textbackslash{}name\textless{}\$\textgreater{}}"
        in table_formats.latex(found)
    )
    assert table_formats.markdown(found).startswith(r"| system | we\|ird_~^\name<$> AP | ")


def test_plain_tables_are_aligned():
    lines = table_formats.plain(table()).splitlines()
    ends = [[match.end() for match in re.finditer(r"\S+", line)] for line in lines[2:]]
    assert {line[-1] for line in ends} == {len(lines[1])}


def test_the_papers_figures_are_those_of_its_tables(data):
    text = (data.parent / "reference" / "etd_paper.tex").read_text()
    by_paper = {name: system for system, name in METHODS.items()}
    for label in ("tab:ecd_results", "tab:eed_results"):
        part = text[text.index(rf"\label{{{label}}}") :]
        part = part[: part.index(r"\end{table*}")].replace(r"\_", "_")
        sequences = re.findall(r"\\multicolumn\{2\}\{c\|\}\{(\w+)\}", part)
        rows = 0
        for line in part.splitlines():
            name = re.match(r"\s*([\w-]+)(\\cite\{\w+\})?\s*&", line)
            if name and name.group(1) in by_paper:
                numbers = [float(number) for number in re.findall(r"\d\.\d{3}", line)]
                pairs = dict(zip(sequences, zip(numbers[::2], numbers[1::2], strict=True), strict=True))
                assert pairs == {sequence: printed(sequence)[by_paper[name.group(1)]] for sequence in sequences}
                rows += 1
        assert rows == len(METHODS)
        assert len(sequences) == 4


def test_other_sequences_have_no_figures_in_the_paper():
    assert printed("desk_1") == {}
