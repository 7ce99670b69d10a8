"""The loss: where the target's centre is (focal), and its box there (generalised intersection over union)."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from etd_ros.recovery.compact import Response, boxes_of, place_centers
from etd_ros.recovery.training.pairs import HIDDEN_MAX, SEEN_MIN

POSITIVE_SHARE = 0.25
"""Places nearer to the target's centre than this share of its sides are positive ..."""
NEGATIVE_SHARE = 0.5
"""... and those farther than this (beside the box) negative; between both they are left out."""
FOCAL_POWER = 2.0
NEGATIVE_WEIGHT = 0.75
BOX_WEIGHT = 1.2
OTHER_WEIGHT = 0.5


class Labels(NamedTuple):
    """What each place should say.

    Attributes:
        positive: the target's centre is there, bool, shape (n, rows, columns).
        negative: it is not, bool, the same shape.
    """

    positive: Tensor
    negative: Tensor


class Losses(NamedTuple):
    """Parts of the loss, scalars: of the places, of the boxes, and of windows where the target is not."""

    score: Tensor
    box: Tensor
    other: Tensor

    @property
    def total(self) -> Tensor:
        return self.score + BOX_WEIGHT * self.box + OTHER_WEIGHT * self.other


def labels_of(boxes: Tensor, visible: Tensor, rows: int, columns: int) -> Labels:
    """Labels of the places of windows.

    Args:
        boxes: of the targets, as centre x, y, width, height on the window (pixels), shape (n, 4).
        visible: share of each target that can be seen, shape (n,).
        rows: places down.
        columns: places across.
    """
    x, y, w, h = (boxes[:, index, None, None] for index in range(4))
    offset_x = (place_centers(columns, device=boxes.device) - x).abs() / w
    offset_y = (place_centers(rows, device=boxes.device)[:, None] - y).abs() / h
    farther = torch.maximum(offset_x, offset_y)
    nearest = farther == farther.amin((1, 2), keepdim=True)
    inside = farther < POSITIVE_SHARE
    # A small target's centre may lie between the places: the nearest one has it, if it is on the box.
    positive = (inside | (nearest & (farther < NEGATIVE_SHARE))) & (visible >= SEEN_MIN)[:, None, None]
    hidden = (visible <= HIDDEN_MAX)[:, None, None]
    return Labels(positive, (farther > NEGATIVE_SHARE) | hidden)


def losses_of(response: Response, others: Tensor, sizes: Tensor, boxes: Tensor, visible: Tensor) -> Losses:
    """The parts of the loss.

    Args:
        response: to each pair.
        others: logits where exemplars were matched with the windows of other pairs, shape (n, rows, columns).
        sizes: as in `Batch`.
        boxes: as in `Batch`.
        visible: as in `Batch`.
    """
    rows, columns = response.logits.shape[-2:]
    labels = labels_of(boxes, visible, rows, columns)
    count = labels.positive.sum().clamp(min=1)
    probability = response.logits.sigmoid()
    found = -functional.logsigmoid(response.logits) * (1 - probability) ** FOCAL_POWER
    refused = -functional.logsigmoid(-response.logits) * probability**FOCAL_POWER
    score = ((found * labels.positive).sum() + NEGATIVE_WEIGHT * (refused * labels.negative).sum()) / count
    other = (-functional.logsigmoid(-others) * others.sigmoid() ** FOCAL_POWER).sum() / count
    predicted = boxes_of(response.changes, sizes)
    overlap = generalised_iou(predicted, boxes[:, :, None, None].expand_as(predicted))
    box = ((1 - overlap) * labels.positive).sum() / count
    return Losses(score, box, other)


def generalised_iou(boxes: Tensor, others: Tensor) -> Tensor:
    """Of boxes as centre x, y, width, height along dimension 1 (Rezatofighi et al. 2019); -1 to 1."""
    overlap, union = _overlap_and_union(boxes, others)
    x, y, w, h = boxes.unbind(1)
    other_x, other_y, other_w, other_h = others.unbind(1)
    hull = _hull(x, w, other_x, other_w) * _hull(y, h, other_y, other_h)
    return overlap / union - (hull - union) / hull


def intersection_over_union(boxes: Tensor, others: Tensor) -> Tensor:
    """Of boxes as centre x, y, width, height along dimension 1; 0 to 1."""
    overlap, union = _overlap_and_union(boxes, others)
    return overlap / union


def _overlap_and_union(boxes: Tensor, others: Tensor) -> tuple[Tensor, Tensor]:
    x, y, w, h = boxes.unbind(1)
    other_x, other_y, other_w, other_h = others.unbind(1)
    overlap = _overlap(x, w, other_x, other_w) * _overlap(y, h, other_y, other_h)
    return overlap, w * h + other_w * other_h - overlap


def _overlap(center: Tensor, side: Tensor, other: Tensor, other_side: Tensor) -> Tensor:
    far = torch.minimum(center + side / 2, other + other_side / 2)
    return (far - torch.maximum(center - side / 2, other - other_side / 2)).clamp(min=0)


def _hull(center: Tensor, side: Tensor, other: Tensor, other_side: Tensor) -> Tensor:
    far = torch.maximum(center + side / 2, other + other_side / 2)
    return far - torch.minimum(center - side / 2, other - other_side / 2)
