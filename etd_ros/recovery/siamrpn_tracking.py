"""DaSiamRPN as a tracker: an exemplar of the first picture, looked for round the last place; look-alikes that were
seen beside it count against a place; and where it is lost, the search grows until it spans the picture (Zhu et al.
2018, Sec. 3.3 and 3.4). The scoring is that of SiamRPN (Li et al. 2018, Sec. 4.3)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from etd_ros.boxes import Box
from etd_ros.recovery.crops import Crop, Picture, cut, exemplar_extent
from etd_ros.recovery.matching import Matcher

STRIDE = 8
SIDE_MIN_PX = 4.0
"""Targets do not become smaller: what is seen of them could not be told from noise."""
DISTRACTORS_MAX = 4
DISTRACTOR_SHARE = 0.5
"""Of the target's score: what scores as much off its box is a look-alike."""
DISTRACTOR_INTERVAL = 10
"""Pictures on which the target is seen, from one on which look-alikes are looked for to the next."""

FloatArray = npt.NDArray[np.floating[Any]]


class Scoring(NamedTuple):
    """How the places of a window are judged.

    Attributes:
        penalty: k of the penalty for changes of size and shape.
        window_influence: share of the Hanning window in a place's score.
        size_rate: how much of a new size is taken, at most.
        instance_side: of the window while the target is seen (pixels at the exemplar's scale).
        instance_side_max: of the window in which a lost one is looked for.
        instance_side_step: what each picture without the target adds to it.
        lost_score: a target that scores less is lost ...
        found_score: ... until a place scores more than this.
        distractor_weight: share of a place's likeness to look-alikes that is taken off its score (Zhu et al. 2018,
            Eq. 5).
    """

    penalty: float
    window_influence: float
    size_rate: float
    instance_side: int
    instance_side_max: int
    instance_side_step: int
    lost_score: float
    found_score: float
    distractor_weight: float = 0.5


VOT = Scoring(0.04, 0.44, 0.45, 271, 831, 56, 0.85, 0.998)
"""Of the published trackers: SiamRPNVOT's; thresholds and the largest window of their long-term variant."""
OTB = VOT._replace(penalty=0.22, window_influence=0.40, size_rate=0.30)
BIG = VOT._replace(penalty=0.055, window_influence=0.42, size_rate=0.295)
COMPACT = Scoring(0.04, 0.1, 0.45, 128, 416, 32, 0.1, 0.3)
"""Of the compact network: chosen on simulated videos (docs/training.md)."""


class SiamRpnTracker:
    """Follows one target from picture to picture.

    Args:
        matcher: the network, which other targets may share.
        scoring: how its answers are judged.
    """

    def __init__(self, matcher: Matcher, scoring: Scoring) -> None:
        self._matcher, self._scoring = matcher, scoring
        self._template: Any = None
        self._distractors: list[Any] = []
        self._center, self._size = (0.0, 0.0), (0.0, 0.0)
        self._pictures_lost = 0
        self._pictures_seen = 0

    def start(self, picture: Picture, box: Box) -> None:
        """The target is at `box` (pixels); `picture` is uint8, grey or BGR."""
        self._center, self._size = box.center, (box.w, box.h)
        self._distractors, self._pictures_lost, self._pictures_seen = [], 0, 0
        self._template = self._template_at(picture, box)

    def update(self, picture: Picture) -> tuple[Box | None, float]:
        """The target's box in the next picture, None where it is lost; and how sure the network is, 0 to 1."""
        crop = self._window(picture)
        answers = self._matcher.match(crop.pixels, [self._template], self._distractors)
        scores, boxes = answers.scores[0].reshape(-1), answers.boxes[0].reshape(4, -1)
        penalty = self._penalty(answers.boxes[0], crop.scale)
        best = int(np.argmax(self._judged(answers.scores, penalty)))
        score = float(scores[best])
        scoring, is_lost = self._scoring, self._pictures_lost > 0
        # Weights that overflow make scores that are no numbers.
        if not score >= (scoring.found_score if is_lost else scoring.lost_score):
            self._pictures_lost += 1
            return None, score if math.isfinite(score) else 0.0
        self._pictures_lost = 0
        rate = scoring.size_rate * float(penalty.flat[best]) * score
        self._follow(crop.on_image(*boxes[:, best].tolist()), rate, picture.shape)
        self._pictures_seen += 1
        if self._pictures_seen % DISTRACTOR_INTERVAL == 0:
            self._distractors = list(self._look_alikes(picture, crop, scores, boxes, score))
        return self._box, score

    @property
    def _box(self) -> Box:
        (x, y), (w, h) = self._center, self._size
        return Box(x - w / 2, y - h / 2, w, h)

    def _template_at(self, picture: Picture, box: Box) -> Any:
        side = self._matcher.geometry.exemplar_side
        scale = side / exemplar_extent(box.w, box.h)
        exemplar = cut(picture, box.center, scale, (side, side)).pixels
        return self._matcher.template(exemplar, (box.w * scale, box.h * scale))

    def _window(self, picture: Picture) -> Crop:
        """Round the last place; the larger, the longer the target has been lost, up to the whole picture."""
        scoring = self._scoring
        scale = self._matcher.geometry.exemplar_side / exemplar_extent(*self._size)
        grown = min(scoring.instance_side_step * self._pictures_lost, scoring.instance_side_max - scoring.instance_side)
        # More than twice the picture's side shows nothing more, wherever the window is.
        useful = 2 * max(picture.shape[:2]) * scale - scoring.instance_side
        side = scoring.instance_side + min(grown, STRIDE * math.ceil(max(0.0, useful) / STRIDE))
        return cut(picture, self._center, scale, (side, side))

    def _judged(self, scores: FloatArray, penalty: FloatArray) -> FloatArray:
        """Likeness to the target less that to look-alikes, after penalty and window; shape of `penalty`."""
        likeness = scores[0]
        if len(scores) > 1:
            likeness = likeness - self._scoring.distractor_weight * scores[1:].mean(0)
        judged: FloatArray = penalty * likeness
        # A lost target may be anywhere.
        if self._pictures_lost:
            return judged
        hanning = np.outer(np.hanning(judged.shape[-2]), np.hanning(judged.shape[-1]))
        influence = self._scoring.window_influence
        return np.asarray((1 - influence) * judged + influence * hanning)

    def _penalty(self, boxes: FloatArray, scale: float) -> FloatArray:
        """exp(-k (s r - 1)), s and r the changes, either way, of size and of shape (Li et al. 2018, Eq. 12)."""
        w, h = boxes[2], boxes[3]
        last_w, last_h = (side * scale for side in self._size)
        padding, last_padding = (w + h) / 2, (last_w + last_h) / 2
        extent = np.sqrt((w + padding) * (h + padding))
        last_extent = math.sqrt((last_w + last_padding) * (last_h + last_padding))
        change = _either_way(extent / last_extent) * _either_way((w / h) / (last_w / last_h))
        return np.asarray(np.exp(-self._scoring.penalty * (change - 1)))

    def _follow(self, found: Box, rate: float, shape: tuple[int, ...]) -> None:
        """Go where the target was found; its size follows at a rate, and stays within the picture's."""
        height, width = shape[:2]
        x, y = found.center
        w, h = ((1 - rate) * old + rate * new for old, new in zip(self._size, (found.w, found.h), strict=True))
        self._center = min(max(x, 0.0), float(width)), min(max(y, 0.0), float(height))
        self._size = min(max(w, SIDE_MIN_PX), float(width)), min(max(h, SIDE_MIN_PX), float(height))

    def _look_alikes(
        self, picture: Picture, crop: Crop, scores: FloatArray, boxes: FloatArray, score: float
    ) -> Iterator[Any]:
        """Templates of what was much like the target beside it, the likeliest first.

        Args:
            picture: with the target.
            crop: the window on it.
            scores: of its places, shape (n,).
            boxes: there, on the window, shape (4, n).
            score: of the target.
        """
        taken = [self._box]
        for place in np.argsort(scores)[::-1]:
            if scores[place] < DISTRACTOR_SHARE * score or len(taken) > DISTRACTORS_MAX:
                return
            box = crop.on_image(*boxes[:, place].tolist())
            if all(_is_beside(box, other) for other in taken):
                taken.append(box)
                yield self._template_at(picture, box)


def _either_way(ratio: FloatArray) -> FloatArray:
    return np.maximum(ratio, 1 / ratio)


def _is_beside(box: Box, other: Box) -> bool:
    """Whether a box's centre lies off another box."""
    (x, y), (other_x, other_y) = box.center, other.center
    return abs(x - other_x) > other.w / 2 or abs(y - other_y) > other.h / 2
