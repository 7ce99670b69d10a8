"""The policy for DDS security: shipped, well formed, and without a right that nobody has looked at."""

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

NODES = ("accumulator", "pipeline", "reconstruction", "replay", "tracker")
RIGHTS = {"topics": {"publish", "subscribe"}, "services": {"reply"}}
CHILDREN = {"topics": "topic", "services": "service"}


@pytest.fixture
def policy(repository: Path) -> ElementTree.Element:
    return ElementTree.parse(repository / "security" / "policy.xml").getroot()


def test_the_policy_has_an_enclave_for_each_executable(policy, repository):
    assert (policy.tag, policy.attrib) == ("policy", {"version": "0.2.0"})
    enclaves = {enclave.get("path"): enclave for enclave in policy.iterfind("enclaves/enclave")}
    assert set(enclaves) == {f"/etd_ros/{name}" for name in NODES}
    for path, enclave in enclaves.items():
        (profile,) = enclave.iterfind("profiles/profile")
        assert profile.attrib == {"ns": "/", "node": path.rpartition("/")[2]}


def test_each_rule_allows_one_thing_to_names_without_wildcards(policy):
    for profile in policy.iter("profile"):
        for rule in profile:
            (right,) = rule.attrib
            assert right in RIGHTS[rule.tag]
            assert rule.get(right) == "ALLOW"
            names = [element.text for element in rule]
            assert {element.tag for element in rule} == {CHILDREN[rule.tag]}
            assert len(set(names)) == len(names) > 0
            assert not any(set(name) & set("*?[] \n") for name in names)


def test_nobody_may_call_a_service_or_publish_what_another_node_makes(policy):
    made = [
        f"{profile.get('node')}{element.text[1:]}"
        for profile in policy.iter("profile")
        for rule in profile
        for element in rule
        if element.text.startswith("~/") and {"publish", "reply"} & set(rule.attrib)
    ]
    others = [
        element.text
        for rule in policy.iter()
        if {"publish", "reply"} & set(rule.attrib)
        for element in rule
        if not element.text.startswith(("~/", "/"))
    ]
    assert len(made) == len(set(made))
    assert others == []
    assert not [rule for rule in policy.iter("services") if "request" in rule.attrib]


def test_relative_names_are_those_that_the_launch_files_leave_to_the_namespace(policy):
    """So that a profile of another namespace needs no more than another `ns`."""
    relative = {element.text for element in policy.iter("topic") if not element.text.startswith(("~/", "/"))}
    assert relative == {"accumulator/frames", "reconstruction/image_raw", "tracker/search_regions"}
