"""Recovery with a Siamese network: distractor-aware and from local to global (Zhu et al. 2018, Sec. 3.3 and 3.4)."""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from etd_ros.boxes import Box
from etd_ros.recovery.appearance import GreyImage
from etd_ros.recovery.config import SIAMRPN, RecoveryConfig
from etd_ros.recovery.crops import Crop, cut, exemplar_extent
from etd_ros.recovery.interface import WIDER_SEARCHES, Found, check_image
from etd_ros.recovery.matching import Answers, Matcher

DISTRACTORS_MAX = 4
DISTRACTOR_SCORE_MIN = 0.3
"""A place away from the target that scores as much while tracking is right is remembered as a distractor."""
SETTLED_MAX = 3
"""Views that are used beside the first one."""
SURROUNDINGS_SIDE = 224
"""Side of the crops that distractors are looked for in (pixels at the exemplar's scale)."""
SAME_PLACE_IOU = 0.4
"""Boxes of successive images that overlap so much are one place."""
STRIDE = 8
WATCH_SCALE = 3.5
"""Width and height of what is searched while the target is followed, in those of the target."""


class View(NamedTuple):
    """A moment of right tracking, kept as pixels: the network looks at it only when the target is looked for.

    Attributes:
        exemplar: the target and its context, uint8, shape (side, side).
        size: width and height of the target on it (pixels).
        surroundings: what is around it, at the same scale, the target in the middle.
        box_size: width and height of the target on the sensor (pixels).
    """

    exemplar: GreyImage
    size: tuple[float, float]
    surroundings: GreyImage
    box_size: tuple[float, float]


@dataclass(frozen=True, slots=True)
class _Distractor:
    """What looked like the target, by how much it did, and the network's template of it."""

    score: float
    template: Any


@dataclass(frozen=True, slots=True)
class Candidate:
    """The likeliest place of a search.

    Attributes:
        box: on the image (pixels).
        score: likeness to the target less that to distractors.
        margin: distance of the score to that of the best place beside the box.
    """

    box: Box
    score: float
    margin: float


class SiameseRecovery:
    """A `RecoveryTracker`. One network serves all targets; each keeps what its own target looked like.

    `remember` only copies pixels, because it is called while tracking is right and must not slow that down. The first
    searches after that make exemplars and distractors of them.

    Attributes:
        latest: the likeliest place of the last search, found convincingly or not; None where there was none.
    """

    def __init__(self, matcher: Matcher, config: RecoveryConfig) -> None:
        self.latest: Candidate | None = None
        self._matcher = matcher
        self._config = config
        self._first: View | None = None
        self._newest: View | None = None
        self._settled: deque[View] = deque(maxlen=SETTLED_MAX)
        self._size = (0.0, 0.0)
        self._templates: list[Any] = []
        self._unlearnt: list[View] = []
        self._distractors: list[_Distractor] = []
        self._images_since = 0
        self._searches = self._wider_by = 0
        self._agreeing: list[Box] = []

    @property
    def has_lead(self) -> bool:
        """Whether the last search found something convincingly, which the next ones have to confirm."""
        return bool(self._agreeing)

    def remember(self, image: GreyImage, box: Box) -> None:
        """Keep the target's appearance, once in `exemplar_interval` calls; `image` is uint8, shape (h, w).

        Raises:
            RecoveryError: not such an image.
        """
        check_image(image)
        self._searches = self._wider_by = 0
        self._agreeing.clear()
        self._images_since += 1
        if self._first is not None and self._images_since < self._config.exemplar_interval:
            return
        column, row = box.center
        if not (0 <= column < image.shape[1] and 0 <= row < image.shape[0]):
            return
        view = self._view(image, box)
        if view.exemplar.std() < self._config.texture_min:
            return
        # The newest is used once the next has come: what a failing tracker saw last is often not the target.
        if self._newest is not None:
            self._settled.append(self._newest)
        if self._first is None:
            self._first = view
        else:
            self._newest = view
        self._templates.clear()
        self._images_since = 0

    def search(self, image: GreyImage, last_box: Box) -> Found | None:
        """The target where it is found convincingly on successive images, in a region that grows from call to call.

        Raises:
            RecoveryError: `image` is not uint8 of shape (h, w).
        """
        check_image(image)
        config = self._config
        if config.network_agreeing == 1:
            # Nothing has to agree with what was found last: a watch goes on from the box.
            self._agreeing.clear()
        candidate = self.latest = self._candidate(image, last_box)
        if (
            candidate is None
            or candidate.score < config.network_score_min
            or candidate.margin < config.network_margin_min
        ):
            self._agreeing.clear()
            return None
        if self._agreeing and candidate.box.iou(self._agreeing[-1]) < SAME_PLACE_IOU:
            self._agreeing.clear()
        self._agreeing.append(candidate.box)
        if len(self._agreeing) < config.network_agreeing:
            return None
        return Found(candidate.box, min(1.0, candidate.score))

    def look_wider(self) -> None:
        """The next region is larger by what `WIDER_SEARCHES` searches would add."""
        self._wider_by += WIDER_SEARCHES

    def forget_lately(self) -> None:
        """Keep the first view alone."""
        self._newest = None
        self._settled.clear()
        self._templates.clear()
        self._agreeing.clear()

    def watch(self) -> SiameseRecovery | None:
        """One image, a higher score, and every image remembered: those of the target's start."""
        config = self._config
        if config.tracker == SIAMRPN or config.watch_score_min >= 1:
            return None
        watching = replace(
            config, network_score_min=config.watch_score_min, network_agreeing=1, exemplar_interval=1,
            search_scale=WATCH_SCALE, search_growth=0.0,
        )  # fmt: skip
        return SiameseRecovery(self._matcher, watching)

    def _candidate(self, image: GreyImage, last_box: Box) -> Candidate | None:
        """The likeliest place in this search's part of the image, of a plausible size; None if there is none."""
        if self._first is None:
            return None
        self._learn()
        # A place that was found on the last image is looked at again rather than left for the next part.
        around = self._agreeing[-1] if self._agreeing else last_box
        crop = self._window(image, around.center)
        self._searches += 1
        distractors = [distractor.template for distractor in self._distractors]
        answers = self._matcher.match(crop.pixels, self._templates, distractors)
        return self._likeliest(answers, crop, image)

    def _view(self, image: GreyImage, box: Box) -> View:
        side = self._matcher.geometry.exemplar_side
        scale = side / exemplar_extent(box.w, box.h)
        surroundings = cut(image, box.center, scale, (SURROUNDINGS_SIDE, SURROUNDINGS_SIDE)).pixels
        rim = (SURROUNDINGS_SIDE - side) // 2
        exemplar = np.ascontiguousarray(surroundings[rim : rim + side, rim : rim + side])
        return View(exemplar, (box.w * scale, box.h * scale), surroundings, (box.w, box.h))

    def _learn(self) -> None:
        """Templates of the views; and, with each search after that, of what was like them around one view, so that
        no search takes several searches' time."""
        assert self._first is not None
        views = [self._first, *self._settled]
        if not self._templates:
            self._size = _usual_size(views)
            usual = [view for view in views if _ratio(view.box_size, self._size) <= self._config.size_ratio_max]
            self._templates = [self._matcher.template(view.exemplar, view.size) for view in usual]
            self._unlearnt = views
            self._distractors.clear()
        elif self._unlearnt:
            found = [*self._distractors, *self._distractors_of(self._unlearnt.pop())]
            self._distractors = sorted(found, key=lambda distractor: -distractor.score)[:DISTRACTORS_MAX]

    def _distractors_of(self, view: View) -> Iterator[_Distractor]:
        """The places beside the target that were like it."""
        answers = self._matcher.match(view.surroundings, self._templates)
        scores = answers.scores.max(0)
        middle = SURROUNDINGS_SIDE / 2
        target = Box(middle - view.size[0] / 2, middle - view.size[1] / 2, *view.size)
        crop = Crop(view.surroundings, 0.0, 0.0, 1.0)
        for _ in range(DISTRACTORS_MAX):
            # Without what overlaps the target's own box, and what has been taken before.
            scores = np.where(_beside(answers.boxes[0], target), scores, 0)
            row, column = np.unravel_index(int(np.argmax(scores)), scores.shape)
            if scores[row, column] < DISTRACTOR_SCORE_MIN:
                return
            x, y, w, h = answers.boxes[0, :, row, column].tolist()
            side = self._matcher.geometry.exemplar_side
            exemplar = cut(view.surroundings, (x, y), 1.0, (side, side)).pixels
            yield _Distractor(float(scores[row, column]), self._matcher.template(exemplar, (w, h)))
            target = crop.on_image(x, y, w, h)

    def _window(self, image: GreyImage, center: tuple[float, float]) -> Crop:
        """The part of the region round `center` that is searched now, at the scale of the exemplars."""
        scale = self._matcher.geometry.exemplar_side / exemplar_extent(*self._size)
        region_scale = self._config.search_scale + self._config.search_growth * (self._searches + self._wider_by)
        # The places searched for the centre: the region, as far as it lies on the image.
        reach = [max(side * region_scale / 2, STRIDE / scale) for side in self._size]
        bounds = [
            (max(0.0, min(middle, extent) - half), min(float(extent), max(middle, 0.0) + half))
            for middle, half, extent in zip(center, reach, image.shape[::-1], strict=True)
        ]
        parts = self._parts(bounds, scale)
        # Nearer parts come first; a region that grows begins anew with every size.
        column, row = center
        parts.sort(key=lambda part: math.hypot(part[0] - column, part[1] - row))
        # What may be the target is in the nearest one: to look elsewhere would be to forget it.
        x, y, columns, rows = parts[0 if self._agreeing else self._searches % len(parts)]
        return cut(image, (x, y), scale, (columns, rows))

    def _parts(self, bounds: list[tuple[float, float]], scale: float) -> list[tuple[float, float, int, int]]:
        """Windows that cover a region: centre (pixels of the image), columns and rows (pixels of the window)."""
        _, margin, window_pixels_max = self._matcher.geometry
        sides = [(high - low) * scale for low, high in bounds]
        # A long region makes a long window: only the number of pixels is limited.
        room = math.isqrt(window_pixels_max) - 2 * margin
        if (sides[0] + 2 * margin) * (sides[1] + 2 * margin) <= window_pixels_max:
            counts = [1, 1]
        else:
            counts = [math.ceil(side / room) for side in sides]
        spans = [
            [(low + (index + 0.5) * (high - low) / count, (high - low) / count) for index in range(count)]
            for (low, high), count in zip(bounds, counts, strict=True)
        ]
        return [
            (x, y, *(STRIDE * math.ceil((span * scale + 2 * margin) / STRIDE) for span in (width, height)))  # type: ignore[misc]
            for (x, width), (y, height) in itertools.product(*spans)
        ]

    def _likeliest(self, answers: Answers, crop: Crop, image: GreyImage) -> Candidate | None:
        count = len(self._templates)
        # The view that knows it best decides: a target that has turned looks like one of them, not like their mean.
        likeness = answers.scores[:count].max(0)
        if self._distractors:
            likeness = likeness - self._config.distractor_weight * answers.scores[count:].mean(0)
        # Each place's box is that of the template which knows it better.
        best = np.argmax(answers.scores[:count], axis=0)
        boxes = np.take_along_axis(answers.boxes, best[None, None], axis=0)[0]
        likeness = np.where(self._plausible(boxes, crop, image), likeness, 0)
        row, column = np.unravel_index(int(np.argmax(likeness)), likeness.shape)
        score = float(likeness[row, column])
        # Weights that overflow make scores that are no numbers.
        if not score > 0:
            return None
        x, y, w, h = boxes[:, row, column].tolist()
        beside = _beside(boxes, Box(x - w / 2, y - h / 2, w, h))
        second = float(np.max(likeness, where=beside, initial=0.0))
        return Candidate(crop.on_image(x, y, w, h), score, score - second)

    def _plausible(self, boxes: Any, crop: Crop, image: GreyImage) -> Any:
        """Where boxes (shape (4, rows, columns)) have about the remembered size and their centre on the image."""
        x, y, w, h = boxes
        limit = self._config.size_ratio_max
        ratio_w, ratio_h = w / (self._size[0] * crop.scale), h / (self._size[1] * crop.scale)
        column, row = crop.left + x / crop.scale, crop.top + y / crop.scale
        return (
            (np.maximum(ratio_w, ratio_h) <= limit)
            & (np.minimum(ratio_w, ratio_h) >= 1 / limit)
            & (column >= 0)
            & (column < image.shape[1])
            & (row >= 0)
            & (row < image.shape[0])
        )


def _beside(boxes: Any, box: Box) -> Any:
    """Which boxes (centre x, y, width, height; shape (4, rows, columns)) have their centre off a box's."""
    x, y = box.center
    return np.maximum(np.abs(boxes[0] - x) / box.w, np.abs(boxes[1] - y) / box.h) > 0.5


def _usual_size(views: Sequence[View]) -> tuple[float, float]:
    """The size that the views agree on: of the upper median of their areas, since a target that goes behind something
    leaves smaller and smaller boxes."""
    sizes = sorted((view.box_size for view in views), key=lambda size: -size[0] * size[1])
    return sizes[(len(sizes) - 1) // 2]


def _ratio(size: tuple[float, float], other: tuple[float, float]) -> float:
    """The larger of the ratios, either way, of the widths and of the heights."""
    return max(max(a / b, b / a) for a, b in zip(size, other, strict=True))
