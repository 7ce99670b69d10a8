"""The command `benchmark`: the form of its figures. The figures themselves are not tested."""

import io
import json

import pytest
from rich.console import Console

from etd_ros.benchmarking import report
from etd_ros.cli import main

WHAT = {
    *("conversion", "bare_map", "readout", "high_pass", "noise_filter"),
    *("evt3", "libcaer_cmp", "libcaer", "mono", "event_array_ros2", "event_array_ros1"),
}


@pytest.fixture(scope="module")
def output(tmp_path_factory):
    """A folder that the benchmark has written, and what it printed."""
    folder = tmp_path_factory.mktemp("benchmarks")
    (folder / "README.md").write_text(f"before\n\n{report.TABLE_START}\nold\n{report.TABLE_END}\n\nafter\n")
    return folder


@pytest.fixture(scope="module")
def figures(output, data):
    """The JSON of a short run on the real recordings."""
    assert main(["benchmark", "event-path", "--quick", "--data", str(data), "--write", str(output)]) == 0
    return json.loads((output / "last.json").read_text())


def test_every_part_is_measured_at_both_sensor_sizes(figures):
    measured = {(row["what"], row["sensor"]) for row in figures["rows"]}
    assert measured >= {(what, sensor) for what in WHAT for sensor in ("240x180", "1280x720")}
    assert {row["what"] for row in figures["rows"]} == WHAT | {"conversion_fine", "readout_full"}


def test_recordings_are_measured_where_they_are_found(figures):
    names = {(row["what"], row["stream"]) for row in figures["rows"]}
    assert {
        ("conversion", "slider_depth"),
        ("conversion", "traffic"),
        ("conversion", "driver evt3"),
        ("conversion_fine", "slider_depth"),
        ("evt3", "driver evt3"),
        ("evt3", "driver evt3, words"),
        ("evt3", "driver evt3, one block"),
        ("libcaer_cmp", "driver libcaer_cmp"),
        ("event_array_ros1", "slider_depth"),
    } <= names


def test_a_ratio_says_how_many_times_as_fast_we_are(figures):
    compared = [row for row in figures["rows"] if row["peer"] is not None]
    assert any(row["peer"] == "bare last-event map" for row in compared)
    for row in figures["rows"]:
        assert row["value"] > 0
        assert row["spread"] >= 0
        assert row["unit"] == ("ms" if row["what"].startswith("readout") else "Mev/s")
        if row["peer"] is None:
            assert row["peer_value"] is row["ratio"] is None
        elif row["unit"] == "ms":
            assert row["ratio"] > 0
        else:
            # One round only: there the median of the ratios is the ratio of the medians.
            assert row["ratio"] == pytest.approx(row["value"] / row["peer_value"])


def test_conversions_tell_their_frames(figures):
    for row in figures["rows"]:
        if row["what"].startswith("conversion") and row["stream"] == "slider_depth":
            assert row["frames_per_s"] * row["events_per_frame"] == pytest.approx(row["value"] * 1e6, rel=0.5)
        elif not row["what"].startswith(("conversion", "readout")):
            assert row["frames_per_s"] is row["events_per_frame"] is None


def test_the_machine_is_told(figures):
    assert {"processor", "cores", "python", "packages"} == set(figures["machine"])
    assert "numba" in figures["machine"]["packages"]


@pytest.mark.usefixtures("figures")
def test_the_readme_gets_the_table_between_its_marks(output):
    lines = (output / "README.md").read_text().splitlines()
    assert (lines[0], lines[-1]) == ("before", "after")
    assert "old" not in lines
    start, end = lines.index(report.TABLE_START), lines.index(report.TABLE_END)
    table = [line for line in lines[start:end] if line.startswith("|")]
    assert {line.count("|") for line in table} == {len(report.HEADINGS) + 1}
    assert [path.name for path in output.iterdir() if path.name not in ("README.md", "last.json")] == []


def test_a_group_that_is_not_built_is_refused(capsys):
    with pytest.raises(SystemExit) as exit_:
        main(["benchmark", "guess"])
    assert exit_.value.code == 2
    assert "'guess' is no group of figures" in capsys.readouterr().err


def test_a_folder_of_recordings_that_is_missing_is_refused(tmp_path, capsys):
    assert main(["benchmark", "--quick", "--data", str(tmp_path / "none")]) == 2
    assert "none: no such folder of recordings" in capsys.readouterr().err


def test_a_folder_without_any_of_the_recordings_is_refused(tmp_path, capsys):
    assert main(["benchmark", "--quick", "--data", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert len(error.splitlines()) == 1
    assert f"{tmp_path} holds none of the recordings" in error
    assert "slider_depth.bag" in error


def test_outputs_are_refused_before_anything_is_measured(tmp_path, capsys):
    assert main(["benchmark", "--write", str(tmp_path)]) == 2
    assert "README.md" in capsys.readouterr().err
    (tmp_path / "README.md").write_text("no marks\n")
    assert main(["benchmark", "--write", str(tmp_path)]) == 2
    assert "lacks the lines" in capsys.readouterr().err
    assert (tmp_path / "README.md").read_text() == "no marks\n"


def test_a_plot_is_refused_before_anything_is_measured_and_leaves_nothing_behind(tmp_path, capsys):
    for path, reason in (
        (tmp_path, "is a folder"),
        (tmp_path / "none" / "curves.png", "a folder that exists"),
        (tmp_path / "curves.pdf", "PNG files"),
    ):
        assert main(["benchmark", "--quick", "--scaling", str(path)]) == 2
        error = capsys.readouterr().err
        assert len(error.splitlines()) == 1
        assert str(path) in error
        assert reason in error
    assert list(tmp_path.parent.glob(f".{tmp_path.name}*")) == list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("option", [["--json"], ["--write", "."], ["tracker"]])
def test_curves_are_not_drawn_beside_a_table(tmp_path, capsys, option):
    assert main(["benchmark", *option, "--quick", "--scaling", str(tmp_path / "curves.png")]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert len(printed.err.splitlines()) == 1
    assert "leave out tables, --json and --write" in printed.err
    assert list(tmp_path.iterdir()) == []


def row(**changes) -> report.Row:
    values = {"what": "conversion", "sensor": "240x180", "value": 123.4, "unit": "Mev/s", "peer": None}
    return report.Row(**{**values, "peer_value": None, "ratio": None, "stream": "uniform", "spread": 0.01, **changes})


def test_the_table_leaves_out_what_is_not_there():
    table = report.table([row(), row(peer="other", peer_value=12.345, ratio=10.0)])
    console = Console(width=160, record=True, file=io.StringIO())
    console.print(table)
    assert "frames/s" not in console.export_text(clear=False)
    first, second = (line for line in console.export_text().splitlines() if "123" in line)
    assert [cell.strip() for cell in first.split("│")[1:8]] == [
        "conversion",
        "240x180",
        "uniform",
        "123",
        "Mev/s",
        "",
        "",
    ]
    assert [cell.strip() for cell in second.split("│")[1:9]] == ["", "", "", "123", "Mev/s", "other", "12.3", "10.00"]


def test_no_name_is_cut_however_narrow_the_terminal():
    names = ["overload_latency_p50" + "_" * 100, "overload_latency_p99" + "_" * 100]
    console = Console(width=40, record=True, file=io.StringIO())
    report.print_table([row(what=name) for name in names], console)
    for name in names:
        assert name in console.export_text(clear=False)
