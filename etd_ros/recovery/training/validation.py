"""Figures of a network on pairs that it was not trained on."""

from __future__ import annotations

from collections.abc import Sequence as Items
from typing import NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn

from etd_ros.recovery.compact import INSTANCE_SIDE, Compact, boxes_of
from etd_ros.recovery.training.loss import compare, intersection_over_union, losses_of
from etd_ros.recovery.training.pairs import HIDDEN_MAX, SEEN_MIN, Batch

FALSE_ALARM_SHARE = 0.01
REACH_PX = 36.0
"""Centres nearer to the window's middle than this can be answered."""

NetworkT = TypeVar("NetworkT", bound=nn.Module)


class Figures(NamedTuple):
    """What validation tells.

    Attributes:
        loss: the training's loss.
        overlap: mean IoU of the likeliest box, where the target can be seen.
        found: share of those with an IoU of at least 0.5.
        recall: share of those found with a score above what 1 % of the windows without the target reach.
    """

    loss: float
    overlap: float
    found: float
    recall: float

    def told(self) -> str:
        return f"found {self.found:.3f}, at 1 % false alarms {self.recall:.3f}"


class Tensors(NamedTuple):
    """A batch on a device; crops are float32, shape (n, 1, rows, columns)."""

    exemplars: Tensor
    sizes: Tensor
    windows: Tensor
    boxes: Tensor
    visible: Tensor


def tensors_of(batch: Batch, device: torch.device) -> Tensors:
    """The batch as the network takes it."""
    exemplars, sizes, windows, boxes, visible = (torch.from_numpy(array).to(device) for array in batch)
    memory_format = _memory_format_of(device)
    crops = (crop[:, None].float().contiguous(memory_format=memory_format) for crop in (exemplars, windows))
    return Tensors(next(crops), sizes, next(crops), boxes, visible)


def placed(network: NetworkT, device: torch.device) -> NetworkT:
    """The network on a device, as it takes crops there."""
    network.to(device).to(memory_format=_memory_format_of(device))  # type: ignore[call-overload]
    return network


def _memory_format_of(device: torch.device) -> torch.memory_format:
    """Channels last are a third less time for a step on a CPU, and a half more on a GPU."""
    return torch.channels_last if device.type == "cpu" else torch.contiguous_format


def validate(network: Compact, batches: Items[Tensors]) -> Figures:
    """The figures over all batches; the network is in training mode again afterwards."""
    network.eval()
    with torch.inference_mode():
        rows = [_answers(network, batch) for batch in batches]
    network.train()
    losses, answers = [row[0] for row in rows], np.concatenate([row[1] for row in rows])
    scores, overlaps, is_seen, is_gone = answers.T
    seen, gone = is_seen > 0, is_gone > 0
    # Without any window that lacks the target there is no false alarm to avoid.
    threshold = np.quantile(scores[gone], 1 - FALSE_ALARM_SHARE) if gone.any() else 0.0
    found = overlaps[seen] >= 0.5
    return Figures(
        float(np.mean(losses)),
        float(overlaps[seen].mean()) if seen.any() else 0.0,
        float(found.mean()) if seen.any() else 0.0,
        float((found & (scores[seen] > threshold)).mean()) if seen.any() else 0.0,
    )


def _answers(network: Compact, batch: Tensors) -> tuple[float, npt.NDArray[np.float32]]:
    """The loss, and of each pair: best score, IoU of its box, whether the target is seen, whether it is not there."""
    comparison = compare(network, batch.exemplars, batch.sizes, batch.windows)
    response = comparison.response
    loss = losses_of(comparison, batch.sizes, batch.boxes, batch.visible).total
    best = response.logits.flatten(1).argmax(1)
    boxes = boxes_of(response.changes, batch.sizes).flatten(2)
    chosen = boxes.gather(2, best[:, None, None].expand(-1, 4, 1))
    truth = batch.boxes[:, :, None]
    overlaps = intersection_over_union(chosen, truth)[:, 0]
    offset = (batch.boxes[:, :2] - INSTANCE_SIDE / 2).abs().amax(1)
    seen = (batch.visible >= SEEN_MIN) & (offset <= REACH_PX)
    reaches_in = ((batch.boxes[:, :2] - INSTANCE_SIDE / 2).abs() < (INSTANCE_SIDE + batch.boxes[:, 2:]) / 2).all(1)
    gone = (batch.visible <= HIDDEN_MAX) | ~reaches_in
    scores = response.logits.flatten(1).amax(1).sigmoid()
    answers = torch.stack([scores, overlaps, seen.float(), gone.float()], 1)
    return float(loss), answers.cpu().numpy()
