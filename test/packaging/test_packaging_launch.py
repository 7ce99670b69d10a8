"""The launch files' own logic, with stand-ins for the launch packages, which pip cannot give."""

import runpy
import sys
from types import ModuleType, SimpleNamespace

import pytest

from etd_ros.tracking import METHODS

SHARE = "share/etd_ros"
FILES = ("camera", "camera_host", "cameras", "compute_host", "middleware", "pipeline", "replay")
EXECUTABLES = {"accumulator", "pipeline", "reconstruction", "replay", "tracker"}


class Thing:
    """Any action or substitution: what it was made of."""

    def __init__(self, *arguments, **options):
        self.arguments = arguments
        self.options = options


class Declared(Thing):
    pass


class Included(Thing):
    pass


class Called(Thing):
    pass


class Variable(Thing):
    pass


class Started(Thing):
    pass


class Configuration(Thing):
    def text(self, context) -> str:
        return context.launch_configurations[self.arguments[0]]


class Expression(Thing):
    def text(self, context) -> str:
        (parts,) = self.arguments
        return str(eval("".join(text(part, context) for part in parts)))


class Share(Thing):
    def text(self, context) -> str:
        return SHARE


class Joined(Thing):
    def text(self, context) -> str:
        (parts,) = self.arguments
        return "/".join(text(part, context) for part in parts)


def text(value: str | Thing, context) -> str:
    return value if isinstance(value, str) else value.text(context)


STAND_INS = {
    "launch": {"LaunchContext": SimpleNamespace, "LaunchDescription": lambda entities: entities},
    "launch.actions": {
        "DeclareLaunchArgument": Declared,
        "IncludeLaunchDescription": Included,
        "OpaqueFunction": Called,
        "SetEnvironmentVariable": Variable,
    },
    "launch.substitutions": {
        "LaunchConfiguration": Configuration,
        "PathJoinSubstitution": Joined,
        "PythonExpression": Expression,
    },
    "launch_ros": {},
    "launch_ros.actions": {"Node": Started},
    "launch_ros.parameter_descriptions": {"ParameterValue": Thing},
    "launch_ros.substitutions": {"FindPackageShare": Share},
}


class Launched:
    """What a launch file starts, visited in `launch`'s order: arguments, then what is included, then functions."""

    def __init__(self, repository, arguments: dict[str, str], environment: dict[str, str]) -> None:
        self.declared: dict[str, dict] = {}
        self.nodes: list[dict] = []
        self._repository = repository
        self._context = SimpleNamespace(launch_configurations=dict(arguments), environment=dict(environment))

    @property
    def environment(self) -> dict[str, str]:
        return self._context.environment

    def node(self, executable: str, namespace: str | None = None) -> dict:
        (found,) = (
            node
            for node in self.nodes
            if node["executable"] == executable and namespace in (None, node.get("namespace"))
        )
        return found

    def visit(self, file: str) -> None:
        for entity in runpy.run_path(str(self._repository / "launch" / file))["generate_launch_description"]():
            self._visit_entity(entity)

    def _visit_entity(self, entity: Thing) -> None:
        configurations = self._context.launch_configurations
        if isinstance(entity, Declared):
            (name,) = entity.arguments
            self.declared[name] = entity.options
            if name not in configurations and "default_value" in entity.options:
                configurations[name] = text(entity.options["default_value"], self._context)
            choices = entity.options.get("choices")
            assert choices is None or configurations[name] in choices, f"{name}:={configurations[name]}"
        elif isinstance(entity, Included):
            given = dict(entity.options.get("launch_arguments", ()))
            configurations |= {name: text(value, self._context) for name, value in given.items()}
            self.visit(text(entity.arguments[0], self._context).rpartition("/")[2])
        elif isinstance(entity, Called):
            for made in entity.options["function"](self._context):
                self._visit_entity(made)
        elif isinstance(entity, Variable):
            name, value = entity.arguments
            self.environment[name] = text(value, self._context)
        else:
            assert isinstance(entity, Started)
            self.nodes.append(entity.options)


@pytest.fixture
def launched(monkeypatch, repository):
    """Visits a launch file with arguments and an environment."""
    for name, members in STAND_INS.items():
        module = ModuleType(name)
        vars(module).update(members)
        monkeypatch.setitem(sys.modules, name, module)

    def launch(file: str, environment: dict[str, str] | None = None, **arguments: str) -> Launched:
        made = Launched(repository, arguments, environment or {})
        made.visit(f"{file}.launch.py")
        return made

    return launch


def parameter(node: dict, name: str) -> object:
    """A parameter's value where the launch file gives one, without the wrapping that keeps texts texts."""
    values = node["parameters"][1]
    value = values.get(name)
    if isinstance(value, Thing):
        assert value.options == {"value_type": str}
        (value,) = value.arguments
    return value


def test_every_launch_file_is_looked_at(repository):
    assert {path.name for path in (repository / "launch").iterdir()} >= {f"{file}.launch.py" for file in FILES}
    assert {path.name.partition(".")[0] for path in (repository / "launch").glob("*.launch.py")} == set(FILES)


@pytest.mark.parametrize(
    ("file", "expected"),
    [
        ("camera", ["accumulator", "reconstruction", "tracker"]),
        ("pipeline", ["pipeline"]),
        ("cameras", ["pipeline"]),
        ("camera_host", ["accumulator"]),
        ("compute_host", ["tracker", "reconstruction"]),
        ("replay", ["accumulator", "reconstruction", "tracker", "replay"]),
    ],
)
def test_each_launch_file_starts_its_nodes(launched, file, expected):
    nodes = launched(file, recording="bag").nodes
    assert [node["executable"] for node in nodes] == expected
    assert all(node["package"] == "etd_ros" for node in nodes)
    assert set(expected) <= EXECUTABLES


def test_only_the_nodes_that_read_events_have_them_remapped(launched):
    made = launched("camera", camera="front")
    for name in ("accumulator", "reconstruction"):
        assert made.node(name)["remappings"] == [("~/events", "/front/events")]
    assert made.node("tracker")["remappings"] == []


def test_each_camera_has_its_own_namespace_events_and_files(launched):
    made = launched(
        "cameras",
        cameras="front rear",
        nodes="accumulator tracker",
        events="/{camera}/driver/events",
        params_file="/robot/{camera}.yaml",
        targets_file="/robot/{camera}.csv",
    )
    assert len(made.nodes) == 4
    for camera in ("front", "rear"):
        accumulator, tracker = made.node("accumulator", camera), made.node("tracker", camera)
        assert accumulator["remappings"] == [("~/events", f"/{camera}/driver/events")]
        assert accumulator["parameters"][0] == f"/robot/{camera}.yaml"
        assert parameter(tracker, "targets_file") == f"/robot/{camera}.csv"


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ({"cameras": "front rear front"}, "names one twice"),
        ({"nodes": "accumulator traker"}, "must be some of accumulator"),
        ({"nodes": " "}, "must be some of accumulator"),
    ],
)
def test_arguments_that_cannot_work_are_refused_with_a_reason(launched, arguments, reason):
    with pytest.raises(ValueError, match=reason):
        launched("cameras", **arguments)


@pytest.mark.parametrize(
    ("host", "camera", "compute"),
    [
        ("compute", {"accumulator"}, {"tracker", "reconstruction"}),
        ("camera", {"accumulator", "reconstruction"}, {"tracker"}),
    ],
)
def test_the_hosts_share_the_nodes_between_them(launched, host, camera, compute):
    hosts = [launched(f"{name}_host", reconstruction=host).nodes for name in ("camera", "compute")]
    assert [{node["executable"] for node in nodes} for nodes in hosts] == [camera, compute]
    assert {node["namespace"] for nodes in hosts for node in nodes} == {"event_camera"}


@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
def test_the_launched_nodes_fit_the_method(launched, method):
    made = launched("replay", recording="bag", method=method.name)
    assert parameter(made.node("accumulator"), "conversion") == method.conversion
    assert parameter(made.node("tracker"), "method") == method.name
    assert made.node("reconstruction")["parameters"][-1].get("image_interval_s", 0.05) == method.image_interval_s
    # The reconstruction reads events only for a tracker that recovers: a replay must not wait for it else.
    assert made.node("replay")["arguments"][-2:] == ["--wait-for", "2" if method.recovers else "1"]


def test_a_replay_loops_when_asked_to(launched):
    once, again = (
        launched("replay", recording="bag", loop=loop).node("replay")["arguments"] for loop in ("false", "true")
    )
    assert again == [*once, "--loop"]


def test_a_replay_waits_for_the_pipeline_alone(launched):
    assert launched("replay", recording="bag", nodes="pipeline").node("replay")["arguments"][-1] == "1"


@pytest.mark.parametrize(("file", "node"), [("camera", "tracker"), ("pipeline", "pipeline"), ("replay", "tracker")])
def test_what_is_not_given_stays_as_in_the_parameter_file(launched, file, node):
    made = launched(file, recording="bag")
    assert made.node(node)["parameters"][0] == f"{SHARE}/config/etd_ros.yaml"
    assert made.node(node)["parameters"][1] == {"use_sim_time": file == "replay"}
    given = launched(file, recording="bag", auto="true", targets="1:0,0,9,9")
    assert parameter(given.node(node), "auto") is True
    assert parameter(given.node(node), "targets") == "1:0,0,9,9"


def test_clock_log_level_and_respawn_reach_every_node(launched):
    for node in launched("camera", use_sim_time="true", log_level="debug", respawn="true").nodes:
        assert parameter(node, "use_sim_time") is True
        assert node["ros_arguments"] == ["--log-level", "debug"]
        assert node["respawn"] is True


PROFILES_FILE = "FASTRTPS_DEFAULT_PROFILES_FILE"


@pytest.mark.parametrize("file", FILES)
def test_large_messages_go_through_shared_memory_unless_the_user_has_chosen(launched, file):
    assert launched(file, recording="bag").environment == {PROFILES_FILE: f"{SHARE}/config/fastdds_shm.xml"}
    assert launched(file, recording="bag", shared_memory="false").environment == {}
    for chosen in ({PROFILES_FILE: "own.xml"}, {"FASTDDS_BUILTIN_TRANSPORTS": "LARGE_DATA"}):
        assert launched(file, chosen, recording="bag").environment == chosen


def test_a_discovery_server_is_asked_for_all_topics(launched):
    server = {"ROS_DISCOVERY_SERVER": "10.0.0.1:11811"}
    assert launched("cameras", server).environment["ROS_SUPER_CLIENT"] == "TRUE"
    chosen = {**server, "ROS_SUPER_CLIENT": "FALSE"}
    assert launched("cameras", chosen).environment["ROS_SUPER_CLIENT"] == "FALSE"


def test_every_argument_says_what_it_does(launched):
    for file in FILES:
        for name, options in launched(file, recording="bag").declared.items():
            assert options["description"], name
