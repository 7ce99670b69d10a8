"""Views of boxes along tracks of simulated targets, with what the right box is: kept in a folder, a file for each
scene."""

from __future__ import annotations

import os
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from etd_ros.boxes import Box
from etd_ros.engine import track
from etd_ros.output_files import make_folder
from etd_ros.recovery.training.box_scenes import box_scene
from etd_ros.recovery.training.errors import TrainingError
from etd_ros.simulation import Scene, simulate, true_boxes
from etd_ros.stream import StreamGuard
from etd_ros.targets import TargetStart
from etd_ros.tracking import BoxMisfit, BoxView
from etd_ros.tracking.box_network import UNREADABLE
from etd_ros.tracking.contour_kernels import AGE, POLARITY, Float32Array, X, Y

RANDOM_STREAM = 9
"""Beside the seed."""
START_NS = 1_000_000_000
FIRST_LABEL_S, LABEL_S, LABELS_MIN = 0.03, 0.002, 20
VISIBLE_MIN = 0.9
TARGETS_MAX, VIEWS_MAX = 3, 30
"""Of a scene, and of a target: more views of one tell little that is new."""
FAR = 0.8
"""A box that is farther off than this part of its size is on something else: nothing there says where it should be."""
SHIFT_UNIT, AGE_UNIT = 1 / 16, 1 / 32_000
"""Of what is kept of a point: pixels from the box's middle, parts of the longest age."""
POINTS_MAX = 4096
RIGHTED_SHARE = 0.5
"""Of targets, those whose boxes are put right meanwhile, as well as a network may do it: off by so much of their size
all the time, and differently each time."""
RIGHTED_OFF, RIGHTED_NOISE, RIGHTED_SPREAD = 0.03, 0.05, 0.06


@dataclass(frozen=True, slots=True)
class BoxSamples:
    """Views of a scene, and the boxes that would have been right.

    Attributes:
        points: of all views, one after the other: x, y from the box's middle, age, polarity, in the units above, int16,
            shape (points, 4).
        counts: points of each view, int64, shape (n,).
        boxes: x, y, w, h of each view (pixels), float32, shape (n, 4).
        truths: the right ones, the same.
        motions: velocity along x and y (pixels/s), growing (1/s), span of the points (s), age of the track (s),
            float32, shape (n, 5).
        sensors: width and height (pixels), int64, shape (n, 2).
        usual: as `BoxView` has it, float16, shape (n, 3, cells, cells).
        first: the same.
    """

    points: npt.NDArray[np.int16]
    counts: npt.NDArray[np.int64]
    boxes: Float32Array
    truths: Float32Array
    motions: Float32Array
    sensors: npt.NDArray[np.int64]
    usual: npt.NDArray[np.float16]
    first: npt.NDArray[np.float16]

    def view(self, number: int) -> tuple[BoxView, Box]:
        """A view, and the right box."""
        last = int(self.counts[: number + 1].sum())
        kept = self.points[last - int(self.counts[number]) : last]
        box = Box(*self.boxes[number].tolist())
        right_px_s, down_px_s, growing_per_s, span_s, age_s = self.motions[number].tolist()
        points = np.empty((len(kept), 4), np.float32)
        points[:, X], points[:, Y] = kept[:, :2].T * SHIFT_UNIT + np.array(box.center)[:, None]
        points[:, AGE], points[:, POLARITY] = kept[:, AGE] * (AGE_UNIT * span_s), kept[:, POLARITY]
        width, height = self.sensors[number].tolist()
        view = BoxView(
            target="",
            stamp_ns=0,
            points=points,
            span_s=span_s,
            box=box,
            velocity=np.array([right_px_s, down_px_s]),
            usual=self.usual[number].astype(np.float32),
            first=self.first[number].astype(np.float32),
            sensor=(width, height),
            age_s=age_s,
            growing_per_s=growing_per_s,
        )
        return view, Box(*self.truths[number].tolist())


def simulated_samples(seed: int) -> BoxSamples:
    """Views along the tracks of a seed's scene.

    Raises:
        SimulationError: scikit-image, whose photographs are used, is not installed.
    """
    rng = np.random.default_rng([RANDOM_STREAM, seed])
    scene, sensor = box_scene(rng)
    starts = _starts(scene, rng)
    recorder = Recorder(scene, [start.name for start in starts], rng)
    guard = StreamGuard()
    events = simulate(scene, seed=int(rng.integers(2**31)), start_ns=START_NS, config=sensor)
    batches = (batch for part in events for batch in guard.feed(part))
    for _ in track(batches, starts, threads=False, corrector=recorder):
        pass
    return recorder.samples(rng)


class Recorder:
    """A corrector that keeps what it is asked about, and puts some targets' boxes right.

    Args:
        scene: where the targets are.
        targets: their names.
        rng: decides which are put right, and how well.
    """

    def __init__(self, scene: Scene, targets: list[str], rng: np.random.Generator) -> None:
        self._scene, self._rng = scene, rng
        self._off = {
            name: RIGHTED_OFF * rng.standard_normal(4) if rng.random() < RIGHTED_SHARE else None for name in targets
        }
        self._seen: dict[str, list[tuple[BoxView, Box]]] = {name: [] for name in targets}

    def __call__(self, view: BoxView) -> BoxMisfit:
        """How far the box of a view is off, more or less; nothing for a target whose boxes are left as they are."""
        truth = self._scene.box(view.target, (view.stamp_ns - START_NS) * 1e-9)
        misfit, off = misfit_of(view.box, truth), self._off[view.target]
        if abs(misfit[:2]).max() < FAR:
            self._seen[view.target].append((_copied(view), truth))
        if off is None:
            return BoxMisfit(np.zeros(4, np.float32), np.ones(4, np.float32))
        noisy = misfit + off + RIGHTED_NOISE * self._rng.standard_normal(4)
        return BoxMisfit(noisy.astype(np.float32), np.full(4, RIGHTED_SPREAD, np.float32))

    def samples(self, rng: np.random.Generator) -> BoxSamples:
        """What it was asked about, VIEWS_MAX of each target at most."""
        chosen = [
            seen[number]
            for seen in self._seen.values()
            for number in sorted(rng.permutation(len(seen))[:VIEWS_MAX].tolist())
        ]
        views = [view for view, _ in chosen]
        kept = [_kept_points(view) for view in views]
        return BoxSamples(
            np.concatenate([np.empty((0, 4), np.int16), *kept]),
            np.array([len(points) for points in kept], np.int64),
            np.array([view.box for view in views], np.float32).reshape(-1, 4),
            np.array([truth for _, truth in chosen], np.float32).reshape(-1, 4),
            np.array([(*view.velocity, view.growing_per_s, view.span_s, view.age_s) for view in views], np.float32)
            .reshape(-1, 5),
            np.array([view.sensor for view in views], np.int64).reshape(-1, 2),
            np.array([view.usual for view in views], np.float16),
            np.array([view.first for view in views], np.float16),
        )  # fmt: skip


def misfit_of(box: Box, truth: Box) -> Float32Array:
    """How far a box is off, as `BoxMisfit.offsets` says it."""
    (x, y), (true_x, true_y) = box.center, truth.center
    return np.array(
        [(true_x - x) / box.w, (true_y - y) / box.h, np.log(truth.w / box.w), np.log(truth.h / box.h)], np.float32
    )


class SampleCache:
    """Samples by number in a folder, each made once; numbers are their seeds. What was read stays in memory."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._read: dict[int, BoxSamples] = {}

    def __reduce__(self) -> tuple[type[SampleCache], tuple[Path]]:
        """Another process reads the files itself."""
        return SampleCache, (self.folder,)

    def has(self, seed: int) -> bool:
        """Whether a scene's samples have been made."""
        return seed in self._read or self._path(seed).is_file()

    def make(self, seed: int) -> None:
        """Simulate and track a scene unless it is there.

        Raises:
            OutputError: the folder cannot be made.
            TrainingError: the samples cannot be written.
        """
        if self.has(seed):
            return
        make_folder(self.folder)
        samples = simulated_samples(seed)
        partial = self._path(seed).with_suffix(f".{os.getpid()}")
        try:
            with partial.open("wb") as file:
                np.savez(file, **{field.name: getattr(samples, field.name) for field in fields(BoxSamples)})
            partial.replace(self._path(seed))
        except OSError as err:
            msg = f"{self.folder}: samples cannot be written ({err.strerror or err}): make room or name another"
            raise TrainingError(msg) from err
        finally:
            partial.unlink(missing_ok=True)

    def samples(self, seed: int) -> BoxSamples:
        """The samples of a scene, that have been made.

        Raises:
            TrainingError: their file is missing or damaged.
        """
        if seed not in self._read:
            path = self._path(seed)
            try:
                with np.load(path, allow_pickle=False) as file:
                    self._read[seed] = BoxSamples(**{field.name: file[field.name] for field in fields(BoxSamples)})
            except UNREADABLE as err:
                msg = f"{path}: samples are missing or damaged: delete the file to make them anew"
                raise TrainingError(msg) from err
        return self._read[seed]

    def _path(self, seed: int) -> Path:
        return self.folder / f"{seed:07}.box.npz"


def _starts(scene: Scene, rng: np.random.Generator) -> list[TargetStart]:
    """Some of a scene's targets, from when they can be seen."""
    starts = []
    for name in rng.permutation(np.array(scene.targets)).tolist()[:TARGETS_MAX]:
        times_s = np.arange(FIRST_LABEL_S, scene.duration_s, LABEL_S)
        labels = list(true_boxes(scene, name, times_s, visible_min=VISIBLE_MIN))
        if len(labels) >= LABELS_MIN:
            time_s, box = labels[2]
            starts.append(TargetStart(name, box, START_NS + round(time_s * 1e9)))
    return starts


def _copied(view: BoxView) -> BoxView:
    """A view whose arrays nobody else changes."""
    return replace(view, **{name: getattr(view, name).copy() for name in ("points", "velocity", "usual", "first")})


def _kept_points(view: BoxView) -> npt.NDArray[np.int16]:
    """A view's points, or POINTS_MAX of them, evenly spread, as they are kept."""
    points = view.points
    if len(points) > POINTS_MAX:
        points = points[np.linspace(0, len(points) - 1, POINTS_MAX).astype(np.int64)]
    kept = np.empty(points.shape, np.float64)
    kept[:, :2] = (points[:, :2] - np.array(view.box.center)) / SHIFT_UNIT
    kept[:, AGE] = points[:, AGE] / view.span_s / AGE_UNIT
    kept[:, POLARITY] = points[:, POLARITY]
    return np.clip(np.rint(kept), -32_000, 32_000).astype(np.int16)
