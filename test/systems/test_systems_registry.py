"""The list of systems."""

from __future__ import annotations

import pytest

from etd_ros.systems.interface import CompareError
from etd_ros.systems.registry import SYSTEMS, system_named
from etd_ros.tracking import METHODS


def test_the_engines_methods_come_first_and_all_names_are_their_own():
    assert list(SYSTEMS)[: len(METHODS)] == list(METHODS)
    assert all(name == system.name for name, system in SYSTEMS.items())


def test_names_fit_into_commands_tables_and_files():
    assert all(name.replace("-", "").isalnum() and name == name.lower() for name in SYSTEMS)
    assert all(system.description and "\n" not in system.description for system in SYSTEMS.values())


def test_an_unknown_name_is_answered_with_the_known_ones():
    with pytest.raises(CompareError) as caught:
        system_named("etd+")
    assert all(name in str(caught.value) for name in SYSTEMS)
