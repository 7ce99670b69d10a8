"""The layouts for Foxglove and RViz are whole; test_nodes_viewers.py holds them against the running nodes."""

import json

import pytest
import yaml

LAYOUTS = ("pipeline", "three_nodes")
FOXGLOVE_PANELS = {"DiagnosticSummary", "Image", "Plot", "Publish", "StateTransitions"}
"""Of those that Foxglove and its open fork Lichtblick have, under these names, the ones that are used."""
RVIZ_CLASSES = {
    "rviz_common/Displays",
    "rviz_default_plugins/Image",
    "rviz_default_plugins/MoveCamera",
    "rviz_default_plugins/Orbit",
    "rviz_default_plugins/TF",
}


def panels_of(tree) -> list[str]:
    return [tree] if isinstance(tree, str) else panels_of(tree["first"]) + panels_of(tree["second"])


def classes_of(node) -> set[str]:
    if isinstance(node, list):
        return set().union(*map(classes_of, node))
    if not isinstance(node, dict):
        return set()
    return classes_of(list(node.values())) | ({node["Class"]} if node.get("Class") else set())


@pytest.mark.parametrize("name", LAYOUTS)
def test_each_panel_of_a_foxglove_layout_has_a_place_a_title_and_a_type_that_there_is(repository, name):
    layout = json.loads((repository / "foxglove" / f"{name}.json").read_text())
    panels = panels_of(layout["layout"])
    assert sorted(panels) == sorted(layout["configById"])
    assert {panel.partition("!")[0] for panel in panels} == FOXGLOVE_PANELS
    assert all(config["foxglovePanelTitle"] for config in layout["configById"].values())


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_click_in_foxglove_is_a_point_in_pixels(repository, name):
    layout = json.loads((repository / "foxglove" / f"{name}.json").read_text())
    click = layout["configById"]["Publish!click"]
    assert click["datatype"] == "geometry_msgs/msg/PointStamped"
    assert set(json.loads(click["value"])["point"]) == {"x", "y", "z"}


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_configuration_of_rviz_has_known_classes_and_reads_as_the_nodes_send(repository, name):
    config = yaml.safe_load((repository / "rviz" / f"{name}.rviz").read_text())
    assert classes_of(config) == RVIZ_CLASSES
    for display in config["Visualization Manager"]["Displays"]:
        topic = display["Topic"]
        policies = [topic[f"{policy} Policy"] for policy in ("Reliability", "Durability", "History")]
        assert policies == ["Reliable", "Volatile", "Keep Last"], display["Name"]


def test_launching_and_installing_find_them(repository):
    setup = (repository / "setup.py").read_text()
    assert all(f'"{folder}"' in setup for folder in ("foxglove", "rviz"))
