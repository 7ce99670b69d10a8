"""The launch files' own logic, with stand-ins for the launch packages, which pip cannot give."""

import runpy
import sys
from types import ModuleType, SimpleNamespace

import pytest

from etd_ros.tracking import METHODS


class Thing:
    """Any action or substitution: what it was made of."""

    def __init__(self, *arguments, **options):
        self.arguments = arguments
        self.options = options


class Configuration(Thing):
    pass


class Expression(Thing):
    def value(self, **configurations: str) -> str:
        (parts,) = self.arguments
        text = "".join(part if isinstance(part, str) else configurations[part.arguments[0]] for part in parts)
        return str(eval(text))


NAMES = {
    "launch": {"LaunchDescription": SimpleNamespace},
    "launch.actions": {"DeclareLaunchArgument": Thing, "IncludeLaunchDescription": Thing},
    "launch.substitutions": {
        "LaunchConfiguration": Configuration,
        "PathJoinSubstitution": Thing,
        "PythonExpression": Expression,
    },
    "launch_ros": {},
    "launch_ros.actions": {"Node": Thing},
    "launch_ros.parameter_descriptions": {"ParameterValue": Thing},
    "launch_ros.substitutions": {"FindPackageShare": Thing},
}


@pytest.fixture
def described(monkeypatch, repository):
    """All that a launch file describes."""
    for name, members in NAMES.items():
        module = ModuleType(name)
        vars(module).update(members)
        monkeypatch.setitem(sys.modules, name, module)

    def load(file: str) -> list[Thing]:
        things: list[Thing] = []
        sys.modules["launch"].LaunchDescription = things.extend
        runpy.run_path(str(repository / "launch" / file))["generate_launch_description"]()
        return things

    return load


@pytest.fixture
def nodes(described):
    """A launch file's nodes by executable."""

    def load(file: str) -> dict[str, dict]:
        return {
            thing.options["executable"]: thing.options for thing in described(file) if "executable" in thing.options
        }

    return load


@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
def test_the_launched_nodes_fit_the_method(nodes, method):
    parameters = nodes("camera.launch.py")["accumulator"]["parameters"]
    (conversion,) = (value["conversion"] for value in parameters if isinstance(value, dict) and "conversion" in value)
    assert conversion.arguments[0].value(method=method.name) == method.conversion
    # The reconstruction reads events only for a tracker that recovers: a replay must not wait for it else.
    readers = nodes("replay.launch.py")["replay"]["arguments"][-1]
    assert readers.value(method=method.name) == ("2" if method.recovers else "1")


LAUNCH_FILES = ("camera.launch.py", "pipeline.launch.py", "replay.launch.py")


@pytest.mark.parametrize("file", LAUNCH_FILES)
def test_nothing_is_tracked_by_itself_unless_asked_for(described, file):
    defaults = {
        thing.arguments[0]: thing.options["default_value"]
        for thing in described(file)
        if "default_value" in thing.options
    }
    assert defaults["auto"] == "false"


@pytest.mark.parametrize(("file", "node"), [("camera.launch.py", "tracker"), ("pipeline.launch.py", "pipeline")])
def test_the_node_that_tracks_takes_auto_as_a_truth_value(nodes, file, node):
    parameters = nodes(file)[node]["parameters"]
    (auto,) = (value["auto"] for value in parameters if isinstance(value, dict) and "auto" in value)
    assert auto.options == {"value_type": bool}
    assert auto.arguments[0].arguments == ("auto",)


def test_replay_hands_auto_on(described):
    (included,) = (thing for thing in described("replay.launch.py") if "launch_arguments" in thing.options)
    assert dict(included.options["launch_arguments"])["auto"].arguments == ("auto",)
