"""KCF and TLD as OpenCV has them, with its default parameters, as the paper runs them (Sec. 4.1)."""

from __future__ import annotations

import ctypes
import dataclasses
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

from etd_ros.boxes import Box
from etd_ros.settings import Settings
from etd_ros.systems.interface import Answer, CompareError, Picture, PictureTracker

TLD_SIDE_PX = 20
"""What TLD makes of the smaller side of a target that has less."""
TLD_SIDE_MIN_PX = 4
"""Smaller targets would need pictures many times as large."""
NOT_SAID = float("nan")
INSTALL = "pip: opencv-contrib-python-headless; Ubuntu: python3-opencv"


class OpenCvTracker:
    """A `PictureTracker` that runs one of OpenCV's. It is lost where that says so, and asked again on the next picture.

    Args:
        name: KCF or TLD, for the errors.
        create: makes OpenCV's tracker.
    """

    def __init__(self, name: str, create: Callable[[], Any]) -> None:
        self._name = name
        self._tracker = create()

    def start(self, picture: Picture, box: Box) -> None:
        """The target is at `box` (pixels); what of it lies in the picture is taken, in whole pixels.

        Raises:
            CompareError: OpenCV cannot track this box.
        """
        whole = _whole_pixels(box, picture)
        try:
            self._tracker.init(_colour(picture), whole)
        except cv2.error as err:
            msg = f"{self._name}: OpenCV cannot start at the box {whole} ({_reason(err)}): choose another box"
            raise CompareError(msg) from err

    def update(self, picture: Picture) -> Answer:
        """Where it is in the next picture; OpenCV's trackers do not say how sure they are.

        Raises:
            CompareError: OpenCV's tracker fails in another way than losing its target.
        """
        try:
            found, (x, y, w, h) = self._tracker.update(_colour(picture))
        except cv2.error as err:
            msg = f"{self._name}: OpenCV's tracker broke down ({_reason(err)}): choose another box or system"
            raise CompareError(msg) from err
        return Answer(Box(float(x), float(y), float(w), float(h)) if found and w > 0 and h > 0 else None, NOT_SAID)


def kcf_maker(settings: Settings, seed: int) -> Callable[[], PictureTracker]:  # noqa: ARG001
    """What makes KCF trackers (Henriques 2015), which are not random and have no settings.

    Raises:
        CompareError: this OpenCV has no KCF.
    """
    create = _create("KCF", cv2, "TrackerKCF")
    return lambda: _Kcf("KCF", create)


def tld_maker(settings: Settings, seed: int) -> Callable[[], PictureTracker]:  # noqa: ARG001
    """What makes TLD trackers (Kalal 2012), whose random ferns follow from the seed; they have no settings.

    Raises:
        CompareError: this OpenCV has no TLD.
    """
    create = _create("TLD", getattr(cv2, "legacy", None), "TrackerTLD")
    return lambda: _Tld(create, seed)


class _Kcf(OpenCvTracker):
    """OpenCV's KCF learns nothing when it starts: its first update only learns what is in the box."""

    def start(self, picture: Picture, box: Box) -> None:
        super().start(picture, box)
        self.update(picture)


class _Tld(OpenCvTracker):
    """TLD draws the pixel pairs of its ferns from C's `rand` when it starts, and never looks at OpenCV's own generator;
    its other draws come from generators with fixed seeds.

    It enlarges pictures in which a target has less than 20 pixels a side, and then gives boxes of the enlarged picture.
    So that is done here, and undone.
    """

    def __init__(self, create: Callable[[], Any], seed: int) -> None:
        super().__init__("TLD", create)
        self._seed = seed
        self._scale = 1.0

    def start(self, picture: Picture, box: Box) -> None:
        inside = Box(*map(float, _whole_pixels(box, picture)))
        side_px = min(inside.w, inside.h)
        if side_px < TLD_SIDE_MIN_PX:
            msg = (
                f"TLD needs {TLD_SIDE_MIN_PX} pixels a side of a target in the picture, not {side_px:g}: choose another"
            )
            raise CompareError(msg)
        self._scale = max(1.0, TLD_SIDE_PX / side_px)
        # C takes the seeds 0 and 1 for the same.
        ctypes.CDLL(None).srand(ctypes.c_uint(self._seed + 1))
        super().start(self._enlarged(picture), Box(*(value * self._scale for value in inside)))

    def update(self, picture: Picture) -> Answer:
        answer = super().update(self._enlarged(picture))
        if answer.box is None:
            return answer
        return dataclasses.replace(answer, box=Box(*(value / self._scale for value in answer.box)))

    def _enlarged(self, picture: Picture) -> Picture:
        if self._scale == 1:
            return picture
        return np.asarray(cv2.resize(picture, None, fx=self._scale, fy=self._scale), np.uint8)


def _create(name: str, module: Any, class_name: str) -> Callable[[], Any]:
    """What makes OpenCV's tracker of this class.

    Raises:
        CompareError: this OpenCV was built without it.
    """
    create = getattr(module, f"{class_name}_create", None)
    if create is None:
        msg = f"{name}: OpenCV {cv2.__version__} has no {class_name}: install one with contrib modules ({INSTALL})"
        raise CompareError(msg)
    return create  # type: ignore[no-any-return]


def _whole_pixels(box: Box, picture: Picture) -> tuple[int, int, int, int]:
    """What of a box lies in the picture: x, y, w, h, at least a pixel each way."""
    rows, columns = picture.shape[:2]
    left, top = min(max(0, round(box.x)), columns - 1), min(max(0, round(box.y)), rows - 1)
    right, bottom = min(columns, round(box.x + box.w)), min(rows, round(box.y + box.h))
    return left, top, max(1, right - left), max(1, bottom - top)


def _colour(picture: Picture) -> Picture:
    """TLD takes colour pictures only, and KCF has more to go by in them."""
    if picture.ndim == 3:
        return picture
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR), np.uint8)


def _reason(err: cv2.error) -> str:
    """OpenCV's error in a few words."""
    return " ".join(str(getattr(err, "err", "") or err).split())[:100]
