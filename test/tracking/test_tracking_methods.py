"""The methods by name."""

from __future__ import annotations

import pytest

from etd_ros.tracking import METHODS, TrackingError, method_named


@pytest.mark.parametrize(
    ("name", "conversion", "recovers"),
    [
        ("etd-plus", "atsltd_fine", True),
        ("etd", "atsltd", True),
        ("etd-nr", "atsltd", False),
        ("etd-ftw", "fixed_window", True),
    ],
)
def test_the_papers_variants(name, conversion, recovers):
    method = method_named(name)
    assert (method.name, method.conversion, method.recovers) == (name, conversion, recovers)


def test_an_unknown_method_lists_the_known_ones():
    with pytest.raises(TrackingError, match="'sort'.*" + ", ".join(METHODS)):
        method_named("sort")
