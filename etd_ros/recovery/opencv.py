"""Recovery with OpenCV: places that look like the target are found by correlation, refined by one of OpenCV's
single-object trackers, and accepted by appearance and size only."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from etd_ros.boxes import Box
from etd_ros.parameters import Parameters, parameter
from etd_ros.recovery.appearance import (
    PATCH_SIDE_MAX,
    Exemplar,
    GreyImage,
    correlation,
    correlation_map,
    crop,
    cut_window,
)
from etd_ros.recovery.interface import Found, RecoveryError, RecoveryTracker

EXEMPLARS_MAX = 4
CSRT_SCALES = 9
CANDIDATE_MARGIN = 0.05
"""A place may look this much worse than `score_min` before the tracker has put the box right."""


@dataclass(frozen=True)
class RecoveryConfig(Parameters):
    """Parameters of the recovery of lost targets."""

    tracker: str = parameter(
        "csrt",
        "OpenCV tracker that puts the found box right; nano, vit and dasiamrpn need model files",
        choices=("csrt", "kcf", "nano", "vit", "dasiamrpn"),
    )
    score_min: float = parameter(
        0.75,
        "smallest correlation with the remembered target that counts as found: lower finds sooner, and wrong ones",
        low=0.0,
        high=1.0,
    )
    texture_min: float = parameter(
        5.0, "smallest standard deviation of a target's pixels (grey levels): less is not compared", low=0.1, high=127.0
    )
    size_ratio_max: float = parameter(
        1.6, "largest ratio, either way, of the found width or height to the remembered one", low=1.0, high=10.0
    )
    search_scale: float = parameter(
        3.0, "width and height of the first search region, in those of the remembered target", low=1.0, high=100.0
    )
    search_growth: float = parameter(
        0.1, "what a search without success adds to the scale of the search region", low=0.0, high=100.0
    )
    search_scale_max: float = parameter(
        8.0, "largest scale of the search region: larger reaches farther and costs time", low=1.0, high=100.0
    )
    exemplar_interval: int = parameter(
        20,
        "tracked images from one remembered appearance to the next; one is used once the next has come, "
        "because what a failing tracker saw last is often not the target",
        low=1,
        high=100_000,
    )
    nano_backbone: str = parameter("", "file of the nano tracker's backbone (ONNX)")
    nano_head: str = parameter("", "file of the nano tracker's neck and head (ONNX)")
    vit_model: str = parameter("", "file of the vit tracker's network (ONNX)")
    dasiamrpn_model: str = parameter("", "file of the dasiamrpn tracker's network (ONNX)")
    dasiamrpn_kernel_cls1: str = parameter("", "file of the dasiamrpn tracker's classification kernel (ONNX)")
    dasiamrpn_kernel_r1: str = parameter("", "file of the dasiamrpn tracker's regression kernel (ONNX)")


@dataclass(frozen=True, slots=True)
class _Kind:
    """An OpenCV tracker: its class, since when it exists, and which attributes of its parameters are files."""

    class_name: str
    since: str
    files: tuple[tuple[str, str], ...] = ()


KINDS = {
    "csrt": _Kind("TrackerCSRT", "4.5.1 with its contrib modules"),
    "kcf": _Kind("TrackerKCF", "4.5.1 with its contrib modules"),
    "nano": _Kind("TrackerNano", "4.7", (("backbone", "nano_backbone"), ("neckhead", "nano_head"))),
    "vit": _Kind("TrackerVit", "4.9", (("net", "vit_model"),)),
    "dasiamrpn": _Kind(
        "TrackerDaSiamRPN",
        "4.5.3",
        (
            ("model", "dasiamrpn_model"),
            ("kernel_cls1", "dasiamrpn_kernel_cls1"),
            ("kernel_r1", "dasiamrpn_kernel_r1"),
        ),
    ),
}


def make_recovery(config: RecoveryConfig | None = None) -> Callable[[], RecoveryTracker]:
    """What makes a recovery tracker for each target; everything that can fail is tried here.

    Raises:
        RecoveryError: this OpenCV lacks the tracker, or a model file is not named, not there, or not readable.
    """
    config = config or RecoveryConfig()
    make_tracker = _tracker_maker(config)
    return lambda: OpenCvRecovery(config, make_tracker)


def _tracker_maker(config: RecoveryConfig) -> Callable[[], Any]:
    kind = KINDS[config.tracker]
    create = getattr(cv2, f"{kind.class_name}_create", None)
    if create is None:
        msg = (
            f"recovery tracker {config.tracker!r}: OpenCV {cv2.__version__} has no {kind.class_name}; install OpenCV "
            f">= {kind.since} (pip: opencv-contrib-python-headless; Ubuntu: python3-opencv), or choose another tracker"
        )
        raise RecoveryError(msg)
    if config.tracker == "kcf":
        return create  # type: ignore[no-any-return]
    parameters = getattr(cv2, f"{kind.class_name}_Params")()
    if config.tracker == "csrt":
        # Its defaults enlarge every target to 200 pixels and segment it by colour; an exemplar is grey, and has no
        # more than PATCH_SIDE_MAX pixels a side to show.
        parameters.template_size = float(PATCH_SIDE_MAX)
        parameters.number_of_scales = CSRT_SCALES
        parameters.use_segmentation = False
        return lambda: create(parameters)
    for attribute, name in kind.files:
        setattr(parameters, attribute, str(_model_file(config, name)))
    try:
        create(parameters)
    except cv2.error as err:
        files = ", ".join(getattr(config, name) for _, name in kind.files)
        msg = f"recovery tracker {config.tracker!r}: OpenCV cannot load {files}: give the ONNX files made for it"
        raise RecoveryError(msg) from err
    return lambda: create(parameters)


def _model_file(config: RecoveryConfig, name: str) -> Path:
    path = Path(getattr(config, name))
    if not getattr(config, name):
        msg = f"recovery tracker {config.tracker!r} needs a model: set the parameter {name} to its ONNX file"
        raise RecoveryError(msg)
    if not path.is_file() or not os.access(path, os.R_OK):
        msg = f"{path}: no readable file; set the parameter {name} to the ONNX file of {config.tracker!r}"
        raise RecoveryError(msg)
    return path


@dataclass(frozen=True, slots=True)
class _Place:
    """Where a window cut from the image at an exemplar's scale looks most like it; `box` lies in the window."""

    exemplar: Exemplar
    window: GreyImage
    corner: tuple[int, int]
    box: Box
    score: float

    def on_sensor(self, box: Box) -> Box:
        """A box in the window as a box on the sensor.

        Its size is relative to the exemplar's box, whose fractions of a pixel the patch has lost.
        """
        rows, columns = self.exemplar.patch.shape
        w, h = box.w / columns * self.exemplar.size[0], box.h / rows * self.exemplar.size[1]
        column, row = (center / self.exemplar.scale for center in box.center)
        return Box(self.corner[0] + column - w / 2, self.corner[1] + row - h / 2, w, h)


class OpenCvRecovery:
    """A `RecoveryTracker`: correlation proposes, an OpenCV tracker refines, appearance and size decide.

    OpenCV's trackers always answer and learn what they answered. So they start anew from what was remembered
    at each promising place, and their answer counts only if it looks like the target.
    """

    def __init__(self, config: RecoveryConfig, make_tracker: Callable[[], Any]) -> None:
        self._config = config
        self._make_tracker = make_tracker
        self._exemplars: deque[Exemplar] = deque(maxlen=EXEMPLARS_MAX)
        self._newest: Exemplar | None = None
        self._images_since = 0
        self._searches = 0

    def remember(self, image: GreyImage, box: Box) -> None:
        """Keep the target's appearance, once in `exemplar_interval` calls; `image` is uint8, shape (h, w).

        Raises:
            RecoveryError: not such an image.
        """
        _check_image(image)
        self._searches = 0
        self._images_since += 1
        if self._exemplars and self._images_since < self._config.exemplar_interval:
            return
        column, row = box.center
        if not (0 <= column < image.shape[1] and 0 <= row < image.shape[0]):
            return
        exemplar = Exemplar.cut(image, box)
        if exemplar.patch.std() < self._config.texture_min:
            return
        settled = self._newest if self._exemplars else exemplar
        if settled is not None:
            self._exemplars.append(settled)
        self._newest = exemplar if settled is not exemplar else None
        self._images_since = 0

    def search(self, image: GreyImage, last_box: Box) -> Found | None:
        """The best place that looks like the target, in a region around `last_box` that grows from call to call.

        Raises:
            RecoveryError: `image` is not uint8 of shape (h, w).
        """
        _check_image(image)
        scale = self._config.search_scale + self._config.search_growth * self._searches
        region = self._remembered_size(last_box).scaled(
            min(scale, max(self._config.search_scale_max, self._config.search_scale))
        )
        self._searches += 1
        places = [place for exemplar in self._exemplars if (place := self._likeliest(image, region, exemplar))]
        if not places:
            return None
        likeliest = max(places, key=lambda place: place.score)
        found = self._settle(likeliest)
        if found.score < self._config.score_min or not self._plausible(found.box, likeliest.exemplar, image):
            return None
        return found

    def _remembered_size(self, last_box: Box) -> Box:
        """The largest remembered size round the last box's centre: a box that fails has often shrunk or grown, as
        on the last sliver of a target that moves behind something."""
        if not self._exemplars:
            return last_box
        w, h = max((exemplar.size for exemplar in self._exemplars), key=lambda size: size[0] * size[1])
        column, row = last_box.center
        return Box(column - w / 2, row - h / 2, w, h)

    def _likeliest(self, image: GreyImage, region: Box, exemplar: Exemplar) -> _Place | None:
        window, corner = cut_window(image, region, exemplar.scale)
        scores = correlation_map(window, exemplar.patch, self._config.texture_min)
        if not scores.size:
            return None
        row, column = np.unravel_index(int(np.argmax(scores)), scores.shape)
        score = float(scores[row, column])
        if score < self._config.score_min - CANDIDATE_MARGIN:
            return None
        rows, columns = exemplar.patch.shape
        return _Place(exemplar, window, corner, Box(float(column), float(row), float(columns), float(rows)), score)

    def _settle(self, place: _Place) -> Found:
        """The place's own box or the OpenCV tracker's, whichever looks more like the target."""
        refined = self._refine(place.window, place.box, place.exemplar)
        score = self._score(place.window, refined, place.exemplar)
        if score > place.score:
            return Found(place.on_sensor(refined), min(1.0, score))
        return Found(place.on_sensor(place.box), min(1.0, place.score))

    def _refine(self, window: GreyImage, box: Box, exemplar: Exemplar) -> Box:
        """The box where the OpenCV tracker, fresh from the exemplar, sees the target near `box`."""
        rows, columns = exemplar.context.shape
        column, row = box.center
        tracker = self._make_tracker()
        tracker.init(cv2.cvtColor(exemplar.context, cv2.COLOR_GRAY2BGR), exemplar.context_box)
        surroundings = cv2.cvtColor(crop(window, column, row, (columns, rows)), cv2.COLOR_GRAY2BGR)
        answered, (x, y, w, h) = tracker.update(surroundings)
        if not answered or w <= 0 or h <= 0:
            return box
        return Box(x + column - columns / 2, y + row - rows / 2, float(w), float(h))

    def _score(self, window: GreyImage, box: Box, exemplar: Exemplar) -> float:
        """How much a box's pixels, brought to the exemplar's size, look like it."""
        size = max(1, round(box.w)), max(1, round(box.h))
        if max(size) > max(exemplar.context.shape):
            return 0.0
        rows, columns = exemplar.patch.shape
        patch = cv2.resize(crop(window, *box.center, size), (columns, rows), interpolation=cv2.INTER_LINEAR)
        return correlation(exemplar.patch, np.asarray(patch, np.uint8), self._config.texture_min)

    def _plausible(self, box: Box, exemplar: Exemplar, image: GreyImage) -> bool:
        ratios = box.w / exemplar.size[0], box.h / exemplar.size[1]
        if max(*ratios, *(1 / ratio for ratio in ratios)) > self._config.size_ratio_max:
            return False
        column, row = box.center
        return bool(0 <= column < image.shape[1] and 0 <= row < image.shape[0])


def _check_image(image: GreyImage) -> None:
    if image.ndim != 2 or image.dtype != np.uint8 or not image.size:
        msg = f"recovery searches grey images, uint8 of shape (height, width), not {image.dtype} {image.shape}"
        raise RecoveryError(msg)
