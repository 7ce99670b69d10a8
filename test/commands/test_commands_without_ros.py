"""What works without ROS, and what the others say there; and `parameters`."""

from __future__ import annotations

import os
import subprocess
import sys

import command_bags
import pytest
import yaml

from etd_ros.cli import main
from etd_ros.settings import Settings, described_settings, read_parameter_file, settings_from_mapping

WITHOUT_ROS = "import sys; sys.modules['rclpy'] = None; from etd_ros.cli import main; sys.exit(main(sys.argv[1:]))"


def python(repository, code: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(repository)}
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False, env=environment)


@pytest.mark.parametrize("arguments", [("replay", "bags/demo"), ("demo",)])
def test_a_command_that_needs_ros_says_so_in_one_line(repository, arguments):
    process = python(repository, WITHOUT_ROS, *arguments)
    assert process.returncode == 2
    assert process.stdout == ""
    assert process.stderr.count("\n") == 1
    assert "rclpy" in process.stderr
    assert "make setup" in process.stderr


def test_tracking_needs_no_ros(repository, tmp_path):
    output = tmp_path / "tracks.csv"
    bag = str(command_bags.sound(tmp_path / "bag"))
    options = ("--target", "thing:10,10,20,20", "--output", str(output))
    process = python(repository, WITHOUT_ROS, "track", bag, *options)
    assert (process.returncode, process.stderr) == (0, "")
    assert output.is_file()


def test_help_names_every_command_without_ros(repository):
    process = python(repository, WITHOUT_ROS, "--help")
    assert process.returncode == 0
    for command in ("info", "track", "replay", "simulate", "demo", "parameters"):
        assert command in process.stdout


@pytest.mark.parametrize("module", ["etd_ros.engine", "etd_ros.recordings", "etd_ros.commands.track", "msg_adapters"])
def test_the_core_imports_neither_ros_nor_torch(repository, module):
    code = f"import sys, {module}; print(*(name.partition('.')[0] for name in sys.modules))"
    process = python(repository, code)
    assert process.returncode == 0, process.stderr
    loaded = set(process.stdout.split())
    assert {"numpy", module.partition(".")[0]} <= loaded
    assert not loaded & {"rclpy", "torch", "sensor_msgs", "std_msgs", "event_camera_msgs", "vision_msgs"}


def test_an_unknown_command_is_refused(capsys):
    with pytest.raises(SystemExit) as caught:
        main(["guess"])
    assert caught.value.code == 2
    assert "guess" in capsys.readouterr().err


def test_parameters_prints_a_row_for_each_parameter(capsys):
    assert main(["parameters"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2 + len(list(described_settings()))
    assert any(line.startswith("| `tracking.failure_iou` | `0.3` | [0, 1] |") for line in lines)


def test_the_parameter_file_holds_the_defaults_and_the_shipped_one_is_it(capsys, tmp_path, repository):
    assert main(["parameters", "--yaml"]) == 0
    text = capsys.readouterr().out
    (tmp_path / "parameters.yaml").write_text(text)
    assert settings_from_mapping(read_parameter_file(tmp_path / "parameters.yaml")) == Settings()
    shipped = (repository / "config" / "etd_ros.yaml").read_text()
    assert yaml.safe_load(shipped) == yaml.safe_load(text)
