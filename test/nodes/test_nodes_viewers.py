"""What the layouts for Foxglove and RViz show is what the nodes publish."""

import json
import re

import pytest
import yaml

IMAGE = "sensor_msgs/msg/Image"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
NODES = {"pipeline": ("pipeline",), "three_nodes": ("accumulator", "reconstruction", "tracker")}
PATH = re.compile(r"(?P<topic>/[\w/]+)\.status\[")
FIGURE = re.compile(r'\{name=="(\w+)"\}\.values\[:\]\{key=="([^"]+)"\}\.value$')


def topics_of_foxglove(layout) -> dict[str, str]:
    """The topics that the panels read or write, with the types that they need."""
    topics = {}
    for config in layout["configById"].values():
        if "imageMode" in config:
            topics[config["imageMode"]["imageTopic"]] = IMAGE
        if "topicToRender" in config:
            topics[config["topicToRender"]] = DIAGNOSTICS
        if "datatype" in config:
            topics[config["topicName"]] = config["datatype"]
        for path in config.get("paths", ()):
            topics[PATH.match(path["value"]).group("topic")] = DIAGNOSTICS
    return topics


@pytest.mark.parametrize("name", sorted(NODES))
def test_every_topic_and_figure_that_the_viewers_show_is_there(bench, repository, name):
    layout = json.loads((repository / "foxglove" / f"{name}.json").read_text())
    rviz = yaml.safe_load((repository / "rviz" / f"{name}.rviz").read_text())
    wanted = topics_of_foxglove(layout)
    wanted |= {display["Topic"]["Value"]: IMAGE for display in rviz["Visualization Manager"]["Displays"]}
    paths = [path["value"] for config in layout["configById"].values() for path in config.get("paths", ())]
    figures = [match.groups() for match in map(FIGURE.search, paths) if match]
    assert len(wanted) >= 5
    assert len(figures) >= 8
    for node in NODES[name]:
        bench.start(node)

    def are_there() -> bool:
        types = dict(bench.node.get_topic_names_and_types())
        return all(types.get(topic) == [kind] for topic, kind in wanted.items())

    bench.wait_until(are_there, f"the topics are {wanted}")
    for node, key in figures:
        bench.wait_until(lambda node=node, key=key: key in bench.diagnostics.get(node, {}), f"{node} tells its {key}")
