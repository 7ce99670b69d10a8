"""Curves and speed against their definitions."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from etd_ros.evaluation.curves import precision_curve, speed, success_curve


def test_a_success_curve_is_the_share_of_overlaps_of_at_least_each_threshold():
    overlaps = [random.Random(1).random() for _ in range(200)] + [0.0, 0.5, 1.0]
    curve = success_curve(overlaps)
    assert curve.thresholds[[0, 50, 100]].tolist() == [0, 0.5, 1]
    expected = [sum(value >= threshold for value in overlaps) / 203 for threshold in curve.thresholds]
    assert curve.shares.tolist() == expected
    assert curve.area == pytest.approx(np.mean(overlaps), abs=0.01)


def test_a_precision_curve_is_the_share_of_centres_within_each_distance():
    errors_px = [random.Random(2).uniform(0, 70) for _ in range(200)] + [0.0, 20.0, math.inf]
    curve = precision_curve(errors_px)
    assert curve.thresholds.tolist() == list(range(51))
    assert curve.shares.tolist() == [sum(value <= threshold for value in errors_px) / 203 for threshold in range(51)]


def test_the_area_of_a_perfect_curve_is_one_and_of_no_box_zero():
    assert success_curve([1.0, 1.0]).area == 1
    assert precision_curve([0.0]).area == 1
    assert precision_curve([math.inf]).area == 0
    assert success_curve([0.0]).area == pytest.approx(0, abs=0.01)


def test_without_labels_a_curve_has_no_values():
    assert np.isnan(success_curve([]).shares).all()
    assert math.isnan(precision_curve([]).area)


def test_speed_is_answers_and_events_in_the_systems_own_time():
    found = speed(frames=200, events=1_000_000, seconds=0.5)
    assert (found.frame_ms, found.frames_per_s, found.events_per_s) == (2.5, 400, 2_000_000)
    for nothing in (speed(0, 10, 1.0), speed(3, 10, 0.0), speed(3, 10, math.nan)):
        assert math.isnan(nothing.frame_ms)
        assert math.isnan(nothing.events_per_s)
