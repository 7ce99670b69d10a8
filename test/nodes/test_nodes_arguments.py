"""What stands after --ros-args and is wrong: one line of ours and exit code 2, as for every bad input."""

import pytest


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
