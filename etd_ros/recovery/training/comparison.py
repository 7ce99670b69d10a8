"""Recovery trackers side by side on the same losses."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt

from etd_ros.boxes import Box
from etd_ros.recovery.interface import RecoveryTracker
from etd_ros.recovery.training.episodes import REMEMBERED_SHARE_MIN, SEEN_MIN, Episode

RIGHT_IOU = 0.5


class End(str, Enum):
    """How an episode ended."""

    RIGHT = "right"
    """The target was found: IoU of at least 0.5 with the truth."""
    WRONG = "wrong"
    """Something else was taken for it."""
    NOT_FOUND = "not found"


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a tracker made of an episode.

    Attributes:
        end: how it ended.
        returns: whether the target was there to be found.
        wait_s: from the first search on which it could be seen to its right recovery (s); 0 for other ends.
        wait_images: the same in images.
        costs_ms: processor time of every search (ms), that of all of the process's threads.
    """

    end: End
    returns: bool
    wait_s: float
    wait_images: int
    costs_ms: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Row:
    """One tracker's figures.

    Attributes:
        tracker: its name.
        losses: episodes in which the target comes back.
        recovered: share of those found rightly.
        wrong: share of those in which something else was taken for it.
        gone: episodes in which it does not come back.
        false: share of those in which something was taken for it.
        wait_ms: median time to a right recovery (ms).
        wait_images: the same in images.
        cost_median_ms, cost_max_ms: of a search (processor time).
    """

    tracker: str
    losses: int
    recovered: float
    wrong: float
    gone: int
    false: float
    wait_ms: float
    wait_images: float
    cost_median_ms: float
    cost_max_ms: float


def outcome_of(make_tracker: Callable[[], RecoveryTracker], episode: Episode) -> Outcome:
    """Show an episode to a new tracker as the engine would, until it finds something or the images end."""
    tracker, sequence = make_tracker(), episode.sequence
    show_before_loss(tracker, episode)
    costs, seen_from = [], None
    for index, image in searched_images(episode):
        if seen_from is None and sequence.visible[index, episode.target] >= SEEN_MIN:
            seen_from = index
        start = time.process_time()
        found = tracker.search(image, episode.last_box)
        costs.append(1e3 * (time.process_time() - start))
        if found is None:
            continue
        if not is_right(found.box, episode, index):
            return Outcome(End.WRONG, episode.returns, 0.0, 0, tuple(costs))
        since = index if seen_from is None else seen_from
        wait_s = float(sequence.stamps_s[index] - sequence.stamps_s[since])
        return Outcome(End.RIGHT, True, wait_s, index - since, tuple(costs))
    return Outcome(End.NOT_FOUND, episode.returns, 0.0, 0, tuple(costs))


def show_before_loss(tracker: RecoveryTracker, episode: Episode) -> None:
    """Let a tracker remember the target on the images on which it was tracked."""
    for index in range(episode.lost):
        if episode.sequence.visible[index, episode.target] >= REMEMBERED_SHARE_MIN:
            tracker.remember(np.asarray(episode.sequence.images[index]), episode.box(index))


def searched_images(episode: Episode) -> Iterator[tuple[int, npt.NDArray[np.uint8]]]:
    """Number and pixels of the images after the loss."""
    for index in range(episode.first, len(episode.sequence.images)):
        yield index, np.asarray(episode.sequence.images[index])


def is_right(box: Box, episode: Episode, index: int) -> bool:
    """Whether the target is at a box on an image."""
    return episode.returns and box.iou(episode.box(index)) >= RIGHT_IOU


def row_of(tracker: str, outcomes: Iterable[Outcome]) -> Row:
    """The figures of a tracker's outcomes."""
    outcomes = list(outcomes)
    back = [outcome for outcome in outcomes if outcome.returns]
    gone = [outcome for outcome in outcomes if not outcome.returns]
    right = [outcome for outcome in back if outcome.end is End.RIGHT]
    costs = [cost for outcome in outcomes for cost in outcome.costs_ms]
    return Row(
        tracker,
        len(back),
        len(right) / max(1, len(back)),
        sum(outcome.end is End.WRONG for outcome in back) / max(1, len(back)),
        len(gone),
        sum(outcome.end is End.WRONG for outcome in gone) / max(1, len(gone)),
        1e3 * float(np.median([outcome.wait_s for outcome in right])) if right else 0.0,
        float(np.median([outcome.wait_images for outcome in right])) if right else 0.0,
        float(np.median(costs)) if costs else 0.0,
        max(costs, default=0.0),
    )


def table(rows: Iterable[Row]) -> str:
    """The rows as a Markdown table."""
    lines = [
        "| tracker | losses recovered | wrong | false when gone | time to recover, median | search, median / max |",
        "|-|-|-|-|-|-|",
    ]
    lines += [
        f"| {row.tracker} | {row.recovered:.1%} of {row.losses} | {row.wrong:.1%} | {row.false:.1%} of {row.gone} "
        f"| {row.wait_ms:.0f} ms, {row.wait_images:.0f} images | {row.cost_median_ms:.1f} / {row.cost_max_ms:.1f} ms |"
        for row in rows
    ]
    return "\n".join(lines)
