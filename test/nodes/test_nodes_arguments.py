"""What stands after --ros-args and is wrong: one line of ours and exit code 2, as for every bad input."""

import os
import subprocess
import sys

import pytest

from etd_ros.nodes.arguments import holds_parameters_for, own_arguments


@pytest.mark.parametrize("name", ["tracker", "replay"])
@pytest.mark.parametrize(
    "arguments", [("-p", "no_value"), ("--params-file", "/nowhere/parameters.yaml"), ("-r", "__node:=1st")]
)
def test_arguments_that_ros_refuses_are_one_line_and_exit_code_2(bench, repository, name, arguments):
    own = (str(repository / "bags" / "demo"),) if name == "replay" else ()
    assert bench.start(name, *own, ros=arguments).wait(timeout=60) == 2
    lines = [line for line in bench.log(name).splitlines() if line.startswith("etd_ros:")]
    assert len(lines) == 1
    assert arguments[1] in lines[0]
    assert "Traceback" not in bench.log(name)


@pytest.mark.parametrize("words", [("targets:=ball:1,2,3,4", "auto"), ("auto:=true",)])
@pytest.mark.parametrize("name", ["accumulator", "pipeline"])
def test_words_that_mean_nothing_are_one_line_and_exit_code_2(bench, name, words):
    assert bench.start(name, *words).wait(timeout=60) == 2
    (line,) = bench.log(name).splitlines()
    assert line.startswith(f"etd_ros: {' '.join(words)}: ")
    assert "--ros-args -p NAME:=VALUE" in line


@pytest.mark.parametrize(
    ("arguments", "own"),
    [
        ([], []),
        (["a", "--rate", "2"], ["a", "--rate", "2"]),
        (["a", "--ros-args", "-r", "b:=c", "-p", "d:=1", "--", "e", "--ros-args", "-r", "f:=g"], ["a", "e"]),
        (["auto:=true", "--ros-args"], ["auto:=true"]),
    ],
)
def test_what_stands_outside_of_ros_s_arguments_is_the_program_s_own(arguments, own):
    assert own_arguments(["program", *arguments]) == own


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("queue_s:=1", "parameter queue_s needs a number from 0.001 to 3600, not 1: write it as in 0.08"),
        ("queue_s:=-1.0", "parameter queue_s needs a number from 0.001 to 3600, not -1.0: write it as in 0.08"),
        ("auto:=1", "parameter auto needs true or false, not 1: write it as in false"),
        ("targets:=5", "parameter targets needs a text, not 5: write it as in '5'"),
        ("targets_max:=2.0", "parameter targets_max needs a whole number from 1 to 1000, not 2.0: write it as in 64"),
        (
            "contours.person_classes:=dog",
            "parameter contours.person_classes needs a list of texts, not 'dog': write it as in [person, pedestrian]",
        ),
    ],
)
def test_a_parameter_of_another_kind_is_one_line_with_an_example(bench, given, words):
    assert bench.start("pipeline", ros=("-p", given)).wait(timeout=60) == 2
    (line,) = bench.log("pipeline").splitlines()
    assert line == f"etd_ros: {words}"


def warnings_of(bench, name: str) -> list[str]:
    return [line for line in bench.log(name).splitlines() if "no parameters of this node" in line]


def test_parameters_that_a_node_does_not_have_are_one_warning_with_what_may_be_meant(bench):
    bench.start("pipeline", ros=("-p", "tagets:=ball:1,2,3,4", "-p", "noise_filter.windows_s:=0.1", "-p", "xyzzy:=1"))
    bench.wait_until(lambda: bench.figure("pipeline", "life cycle") == "active", "the node runs all the same")
    (line,) = warnings_of(bench, "pipeline")
    for part in ("tagets (is targets meant?)", "noise_filter.windows_s (is noise_filter.window_s meant?)", ", xyzzy ("):
        assert part in line


def test_parameters_of_other_nodes_and_known_ones_are_no_warning(bench, tmp_path, repository):
    file = tmp_path / "parameters.yaml"
    file.write_text(
        "/**:\n  ros__parameters: {queue_s: 3600.0, use_sim_time: false}\n"
        "/other:\n  ros__parameters: {tagets: nothing}\n"
        "/pipeline:\n  ros__parameters: {auto: true, noise_filter: {window_s: 0.01}}\n"
    )
    bench.start("pipeline", ros=("--params-file", str(file)))
    bench.wait_until(lambda: bench.figure("pipeline", "life cycle") == "active", "the node runs")
    assert not warnings_of(bench, "pipeline")


@pytest.mark.parametrize(
    ("content", "is_for_it"),
    [
        ("/robot/tracker: {ros__parameters: {auto: true}}", True),
        ("robot/tracker: {ros__parameters: {auto: true}}", True),
        ("robot: {tracker: {ros__parameters: {auto: true}}}", True),
        ("/**: {ros__parameters: {auto: true}}", True),
        ("/*/tracker: {ros__parameters: {auto: true}}", True),
        ("/**/tracker: {ros__parameters: {auto: true}}", True),
        ("/other: {ros__parameters: {auto: true}}\n/robot: {'**': {ros__parameters: {auto: true}}}", True),
        ("/tracker: {ros__parameters: {auto: true}}", False),
        ("/*: {ros__parameters: {auto: true}}", False),
        ("/robot/track: {ros__parameters: {auto: true}}", False),
        ("/robot/tracker: {ros__parameters: {}}", False),
        ("/robot/tracker: {auto: true}", False),
        ("", False),
        ("target,x\na,1\n", False),
        ("/robot/tracker: [", True),
    ],
)
def test_whether_a_parameter_file_is_for_a_node_is_told_as_ros_does(tmp_path, content, is_for_it):
    file = tmp_path / "parameters.yaml"
    file.write_text(content)
    assert holds_parameters_for("/robot/tracker", file) == is_for_it


@pytest.mark.parametrize("more", [(), ("-p", "queue_s:=3600.0")])
@pytest.mark.parametrize("content", ["/pipelines:\n  ros__parameters: {auto: true}\n", "target,x\na,1\n"])
def test_a_parameter_file_that_holds_none_for_the_node_is_one_warning(bench, tmp_path, content, more):
    file = tmp_path / "parameters.yaml"
    file.write_text(content)
    # Not by the bench, which gives each node a parameter.
    with (tmp_path / "tracker.log").open("w") as log:
        bench.processes["tracker"] = subprocess.Popen(
            [sys.executable, "-m", "etd_ros.nodes", "tracker", "--ros-args", "--params-file", str(file), *more],
            stderr=log,
            env={**os.environ, "ROS_DOMAIN_ID": str(bench.domain)},
        )
    bench.wait_until(lambda: bench.figure("tracker", "life cycle") == "active", "the node runs all the same")
    (line,) = [line for line in bench.log("tracker").splitlines() if "no parameters for" in line]
    assert str(file) in line
    assert "ros__parameters" in line


@pytest.mark.parametrize("name", ["accumulator", "reconstruction", "tracker", "pipeline"])
def test_the_parameter_file_for_all_nodes_is_no_warning_at_any(bench, repository, name):
    bench.start(name, ros=("--params-file", str(repository / "config" / "etd_ros.yaml")))
    bench.wait_until(lambda: bench.figure(name, "life cycle") == "active", "the node runs")
    assert not warnings_of(bench, name)


def test_replay_names_what_it_leaves_out_too(bench, repository):
    bench.start("replay", str(repository / "bags" / "demo"), ros=("-p", "rate:=2.0"))
    bench.wait_until(lambda: bool(warnings_of(bench, "replay")), "it says so")
    assert "left out: rate (harmless" in warnings_of(bench, "replay")[0]
