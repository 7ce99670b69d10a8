"""Simulated sequences as a camera films them: exposures of the scene's light, with a camera's faults."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from etd_ros.recovery.training.scenes import log_uniform, random_situation
from etd_ros.recovery.training.sequences import Pictures, Sequence, truth_of
from etd_ros.simulation import Scene
from etd_ros.simulation.motion import FloatArray
from etd_ros.simulation.rendering import Renderer
from etd_ros.simulation.steps import fastest_px_s

RANDOM_STREAM = 8
"""Beside the seed: no seed makes a scene of another part of the project."""
PERIOD_S = (0.015, 0.05)
"""Shortest and longest time between frames."""
EXPOSURE_SHARE = (0.02, 0.8)
"""Of the time between frames, in which the camera gathers light."""
STEP_PX = 1.5
"""How far things may move between two renderings of one exposure ..."""
RENDERINGS = (2, 16)
"""... of which there are so many."""
MEAN_LEVELS = (50.0, 150.0)
"""What the exposure brings the mean of the first frame to (grey levels)."""
LENS_BLUR_PX = (0.3, 1.0)
PATTERN_LEVELS_MAX, NOISE_LEVELS = 4.0, (0.5, 6.0)
"""Standard deviations over the pixels (grey levels): of each pixel's own offset, and of every frame's noise."""


def video_sequence(seed: int) -> Sequence:
    """The sequence of a seed: a scene, filmed.

    Raises:
        SimulationError: scikit-image, whose photographs are used, is not installed.
    """
    rng = np.random.default_rng([RANDOM_STREAM, seed])
    return filmed(random_situation(rng).scene, rng)


VIDEO = Pictures("frames", "frame_boxes", video_sequence)


def filmed(scene: Scene, rng: np.random.Generator) -> Sequence:
    """What a camera makes of a scene; `rng` decides its rate, exposure and faults. Stamps are mid-exposure."""
    period_s = float(rng.uniform(*PERIOD_S))
    exposure_s = period_s * log_uniform(rng, *EXPOSURE_SHARE)
    starts_s = np.arange(0, scene.duration_s - exposure_s, period_s)
    stamps_s = starts_s + exposure_s / 2
    times_s, frames = _exposures(scene, starts_s, exposure_s)
    light = _gathered(scene, times_s, frames, len(starts_s))
    boxes, visible = truth_of(scene, stamps_s)
    return Sequence(_developed(light, rng), stamps_s, boxes, visible)


def _exposures(scene: Scene, starts_s: FloatArray, exposure_s: float) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    """Times of the renderings (s) and the frame that each belongs to: the more of them, the faster things are."""
    fastest = fastest_px_s(scene, np.concatenate([starts_s, [scene.duration_s]]))[:-1]
    counts = np.clip(np.ceil(fastest * exposure_s / STEP_PX), *RENDERINGS).astype(np.int64)
    times = [
        start + exposure_s * (np.arange(count) + 0.5) / count for start, count in zip(starts_s, counts, strict=True)
    ]
    return np.concatenate(times), np.repeat(np.arange(len(starts_s)), counts)


def _gathered(scene: Scene, times_s: FloatArray, frames: npt.NDArray[np.int64], count: int) -> npt.NDArray[np.float32]:
    """Mean intensity of each frame's renderings, float32, shape (count, height, width)."""
    light = np.zeros((count, scene.height, scene.width), np.float32)
    renderer = Renderer(scene, times_s)
    for number, frame in enumerate(frames):
        renderer.advance(number)
        light[frame] += np.exp(renderer.after)
    counts = np.bincount(frames, minlength=count).astype(np.float32)
    return np.asarray(light / counts[:, None, None], np.float32)


def _developed(light: npt.NDArray[np.float32], rng: np.random.Generator) -> npt.NDArray[np.uint8]:
    """Grey levels of intensities: optics, exposure, each pixel's offset, noise, and what is too bright cut off."""
    blur_px = float(rng.uniform(*LENS_BLUR_PX))
    gain = float(rng.uniform(*MEAN_LEVELS)) / float(light[0].mean())
    pattern = rng.normal(0, rng.uniform(0, PATTERN_LEVELS_MAX), light.shape[1:])
    noise_levels = log_uniform(rng, *NOISE_LEVELS)
    images = np.empty(light.shape, np.uint8)
    for frame, exposed in enumerate(light):
        levels = gain * cv2.GaussianBlur(exposed, (0, 0), blur_px)
        levels = levels + pattern + rng.normal(0, noise_levels, levels.shape)
        images[frame] = np.clip(np.rint(levels), 0, 255)
    return images
