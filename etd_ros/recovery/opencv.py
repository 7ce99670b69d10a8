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
from etd_ros.recovery.appearance import (
    PATCH_SIDE_MAX,
    Exemplar,
    GreyImage,
    correlation,
    correlation_map,
    crop,
    cut_window,
)
from etd_ros.recovery.config import RecoveryConfig
from etd_ros.recovery.interface import WIDER_SEARCHES, Found, RecoveryError, check_image

EXEMPLARS_MAX = 4
CSRT_SCALES = 9
CANDIDATE_MARGIN = 0.05
"""A place may look this much worse than `score_min` before the tracker has put the box right."""
TRIAL_SIDE = 16
"""Of the target that networks are tried on (pixels)."""
REASON_MAX = 80
"""Characters of what OpenCV says."""


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


def tracker_maker(name: str, config: RecoveryConfig) -> Callable[[], Any]:
    """What makes an OpenCV tracker, one of `KINDS`, whose files the configuration names.

    Raises:
        RecoveryError: this OpenCV lacks the tracker, or a model file is not named, not there, not readable, or of
            another network.
    """
    kind = KINDS[name]
    create = getattr(cv2, f"{kind.class_name}_create", None)
    if create is None:
        msg = (
            f"recovery tracker {name!r}: OpenCV {cv2.__version__} has no {kind.class_name}; install OpenCV "
            f">= {kind.since} (pip: opencv-contrib-python-headless; Ubuntu: python3-opencv), or choose another tracker"
        )
        raise RecoveryError(msg)
    if name == "kcf":
        return create  # type: ignore[no-any-return]
    parameters = getattr(cv2, f"{kind.class_name}_Params")()
    if name == "csrt":
        # Its defaults enlarge every target to 200 pixels and segment it by colour; an exemplar is grey, and has no
        # more than PATCH_SIDE_MAX pixels a side to show.
        parameters.template_size = float(PATCH_SIDE_MAX)
        parameters.number_of_scales = CSRT_SCALES
        parameters.use_segmentation = False
        return lambda: create(parameters)
    for attribute, field in kind.files:
        setattr(parameters, attribute, str(_model_file(config, name, field)))
    _silence_warnings()
    try:
        _follow_once(create(parameters))
    except cv2.error as err:
        files = ", ".join(getattr(config, field) for _, field in kind.files)
        fields = ", ".join(f"recovery.{field}" for _, field in kind.files)
        msg = (
            f"{files}: OpenCV's {kind.class_name} cannot track with this ({_reason(err)}): set {fields} to the ONNX "
            f"files made for it, or choose another recovery.tracker than {name!r}"
        )
        raise RecoveryError(msg) from err
    return lambda: create(parameters)


def _silence_warnings() -> None:
    """OpenCV 5 warns of the same at each loading of a network, which is at each search."""
    log = getattr(cv2.utils, "logging", None)
    # Versions before have it elsewhere, or not at all, and nothing to warn of.
    if log is not None and hasattr(log, "setLogLevel"):
        log.setLogLevel(log.LOG_LEVEL_ERROR)


def _follow_once(tracker: Any) -> None:
    """Start and ask a tracker on a small picture: files of another network load, and fail only when they are used.

    Raises:
        cv2.error: it cannot.
    """
    picture = np.random.default_rng(0).integers(0, 256, (4 * TRIAL_SIDE, 4 * TRIAL_SIDE, 3), np.uint8)
    tracker.init(picture, (TRIAL_SIDE, TRIAL_SIDE, TRIAL_SIDE, TRIAL_SIDE))
    tracker.update(picture)


def _reason(err: cv2.error) -> str:
    """OpenCV's error in a few words."""
    return " ".join(str(getattr(err, "err", "") or err).split())[:REASON_MAX]


def _model_file(config: RecoveryConfig, tracker: str, field: str) -> Path:
    path = Path(getattr(config, field))
    if not getattr(config, field):
        msg = f"recovery tracker {tracker!r} needs a model: set the parameter recovery.{field} to its ONNX file"
        raise RecoveryError(msg)
    if not path.is_file() or not os.access(path, os.R_OK):
        msg = f"{path}: no readable file; set the parameter recovery.{field} to the ONNX file of {tracker!r}"
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

    has_lead = False
    """Each search decides for itself."""

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
        check_image(image)
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
        check_image(image)
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

    def look_wider(self) -> None:
        """The next region is larger by what `WIDER_SEARCHES` searches would add, as far as it may be."""
        self._searches += WIDER_SEARCHES

    def forget_lately(self) -> None:
        """Keep the first exemplar alone."""
        while len(self._exemplars) > 1:
            self._exemplars.pop()
        self._newest = None

    def watch(self) -> None:
        """Correlation finds what is like a target nearly everywhere."""

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
        surroundings = cv2.cvtColor(crop(window, column, row, (columns, rows)), cv2.COLOR_GRAY2BGR)
        try:
            tracker = self._make_tracker()
            tracker.init(cv2.cvtColor(exemplar.context, cv2.COLOR_GRAY2BGR), exemplar.context_box)
            answered, (x, y, w, h) = tracker.update(surroundings)
        except cv2.error:
            # CSRT cannot take what is some fifteen times as long as wide; a file may be written anew meanwhile.
            return box
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
