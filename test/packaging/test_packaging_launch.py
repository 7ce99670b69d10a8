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
def nodes(monkeypatch, repository):
    """A launch file's nodes by executable."""
    for name, members in NAMES.items():
        module = ModuleType(name)
        vars(module).update(members)
        monkeypatch.setitem(sys.modules, name, module)

    def load(file: str) -> dict[str, dict]:
        described: list = []
        sys.modules["launch"].LaunchDescription = described.extend
        runpy.run_path(str(repository / "launch" / file))["generate_launch_description"]()
        return {thing.options["executable"]: thing.options for thing in described if "executable" in thing.options}

    return load


@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
def test_the_launched_nodes_fit_the_method(nodes, method):
    parameters = nodes("camera.launch.py")["accumulator"]["parameters"]
    (conversion,) = (value["conversion"] for value in parameters if isinstance(value, dict) and "conversion" in value)
    assert conversion.arguments[0].value(method=method.name) == method.conversion
    # The reconstruction reads events only for a tracker that recovers: a replay must not wait for it else.
    readers = nodes("replay.launch.py")["replay"]["arguments"][-1]
    assert readers.value(method=method.name) == ("2" if method.recovers else "1")
