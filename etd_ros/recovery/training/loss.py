"""The loss: where the target's centre is (focal), and its box there (generalised intersection over union)."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from etd_ros.recovery.compact import Compact, Response, boxes_of, place_centers
from etd_ros.recovery.training.pairs import HIDDEN_MAX, SEEN_MIN

POSITIVE_SHARE = 0.25
"""Places nearer to the target's centre than this share of its sides are positive ..."""
NEGATIVE_SHARE = 0.5
"""... and those farther than this (beside the box) negative; between both they are left out."""
FOCAL_POWER = 2.0
NEGATIVE_WEIGHT = 0.75
BOX_WEIGHT = 1.2
OTHER_WEIGHT = 0.5
OTHERS = 4
"""Windows of other pairs that each exemplar is compared with: negative pairs for the price of a correlation."""


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


class Comparison(NamedTuple):
    """What the network says about a batch.

    Attributes:
        response: to each pair.
        others: logits of exemplars in the windows of pairs after theirs, which are of other sequences unless a batch
            is larger than the number of sequences, shape (k, n, rows, columns); k = 4 where there are as many.
    """

    response: Response
    others: Tensor


def compare(network: Compact, exemplars: Tensor, sizes: Tensor, windows: Tensor) -> Comparison:
    """Each exemplar with its own window and with those of other pairs.

    All in one run: a batch of its own for the others would be normalised by itself, and what they have in common, that
    the target is not there, be taken off.
    """
    kernels, seen = network.remember(exemplars, sizes), network.look(windows)
    shifts = range(max(2, min(OTHERS + 1, len(exemplars))))
    rolled = torch.cat([kernels.score.roll(shift, 0) for shift in shifts])
    logits = network.score.head(correlated(rolled, seen.score))[:, 0].unflatten(0, (len(shifts), -1))
    return Comparison(Response(logits[0], network.box.head(correlated(kernels.box, seen.box))), logits[1:])


def correlated(kernels: Tensor, windows: Tensor) -> Tensor:
    """Each channel of k kernels for each of n windows with that channel of the window, the windows in turn.

    The convolution that the network runs with, as products of matrices: its gradient takes a GPU many times as long.

    Args:
        kernels: shape (k * n, channels, side, side).
        windows: shape (n, channels, rows, columns).

    Returns:
        Shape (k * n, channels, rows - side + 1, columns - side + 1).
    """
    (count, channels), side = windows.shape[:2], kernels.shape[-1]
    patches = windows.unfold(2, side, 1).unfold(3, side, 1)
    rows, columns = patches.shape[2:4]
    flat = patches.reshape(count * channels, rows * columns, side * side)
    products = flat @ kernels.reshape(-1, count * channels, side * side).permute(1, 2, 0)
    return products.permute(2, 0, 1).reshape(-1, channels, rows, columns)


def losses_of(comparison: Comparison, sizes: Tensor, boxes: Tensor, visible: Tensor) -> Losses:
    """The parts of the loss.

    Args:
        comparison: of the pairs.
        sizes: as in `Batch`.
        boxes: as in `Batch`.
        visible: as in `Batch`.
    """
    response, others = comparison
    rows, columns = response.logits.shape[-2:]
    labels = labels_of(boxes, visible, rows, columns)
    count = labels.positive.sum().clamp(min=1)
    probability = response.logits.sigmoid()
    found = -functional.logsigmoid(response.logits) * (1 - probability) ** FOCAL_POWER
    refused = -functional.logsigmoid(-response.logits) * probability**FOCAL_POWER
    score = ((found * labels.positive).sum() + NEGATIVE_WEIGHT * (refused * labels.negative).sum()) / count
    other = (-functional.logsigmoid(-others) * others.sigmoid() ** FOCAL_POWER).sum() / (len(others) * count)
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
