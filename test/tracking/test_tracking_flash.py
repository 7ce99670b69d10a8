"""A flash of light brings events everywhere, which say nothing of where a target is."""

from __future__ import annotations

import numpy as np
import pytest
from tracked_scenes import HEIGHT, WIDTH, frames_of, overlap, scene_of, tracked

from etd_ros.simulation import Path, Scene, Sprite, Waypoint, things
from etd_ros.simulation.backgrounds import BACKGROUNDS
from etd_ros.simulation.motion import Flicker
from etd_ros.tracking.flash import BLOCKS, is_flash

FLASHES_S = 0.2, 0.35


class Flashes(Flicker):
    """Light that is 1.8 times as bright within 2 ms, and fades in some 20."""

    def at(self, times_s):
        light = np.ones_like(times_s)
        for flash_s in FLASHES_S:
            since_s = times_s - flash_s
            light += self.depth * np.where(since_s < 0, np.exp(since_s / 0.001), np.exp(-np.abs(since_s) / 0.006))
        return light


def frame_with(share, *, off_share=0.0, size=(HEIGHT, WIDTH), seed=0):
    """A frame in which such shares of the pixels fire On and Off, anywhere."""
    rng = np.random.default_rng(seed)
    shares = np.array([share, off_share])
    return np.where(rng.random((*size, 2)) < shares, rng.integers(1, 256, (*size, 2)), 0).astype(np.uint8)


@pytest.mark.parametrize("size", [(180, 240), (260, 346), (720, 1280)])
@pytest.mark.parametrize("share", [0.08, 0.5, 1.0])
def test_light_that_gets_brighter_or_darker_everywhere_is_a_flash(size, share):
    brighter = frame_with(share, size=size)
    assert is_flash(brighter)
    assert is_flash(np.ascontiguousarray(brighter[..., ::-1])), "darker"


@pytest.mark.parametrize("share", [0.0, 0.005, 0.05, 0.5])
def test_edges_that_move_fire_in_both_polarities_and_are_none(share):
    assert not is_flash(frame_with(share, off_share=share))


def test_noise_of_one_polarity_in_few_pixels_is_none():
    assert not is_flash(frame_with(0.01))


def test_a_lamp_in_a_part_of_the_scene_is_none():
    lamp = frame_with(1.0)
    lamp[HEIGHT // BLOCKS :] = 0
    assert not is_flash(lamp)


@pytest.mark.parametrize("size", [(1, 1), (3, 2), (2, 500)])
def test_the_smallest_frames_can_be_asked(size):
    assert not is_flash(np.zeros((*size, 2), np.uint8))


def test_a_target_moves_on_through_flashes():
    rng, duration_s = np.random.default_rng(5), 0.5
    way = Path([Waypoint(0.0, 40.0, 90.0), Waypoint(duration_s, 140.0, 90.0)])
    view = Path([Waypoint(0.0, 0.0, 0.0), Waypoint(duration_s, 12.0, 3.0)])
    ball = Sprite("thing", *things.ball(rng, 22), way)
    clutter = BACKGROUNDS["clutter"](rng, HEIGHT + 80, WIDTH + 80)
    scene = Scene(WIDTH, HEIGHT, duration_s, clutter, (ball,), view=view, flicker=Flashes(60.0, 0.8))
    frames = frames_of(scene)
    assert any(is_flash(frame.data) for frame in frames)
    found = tracked(scene, frames=frames)
    assert min(overlap(report, truth) for _, report, truth in found) > 0.5


def test_a_scene_without_flashes_has_none():
    scene = scene_of(Waypoint(0.0, 50.0, 90.0), Waypoint(0.5, 190.0, 90.0), duration_s=0.5)
    assert not any(is_flash(frame.data) for frame in frames_of(scene))
