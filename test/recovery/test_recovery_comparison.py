"""The comparison counts what happened: right, wrong, not found, and how long it took."""

from __future__ import annotations

import numpy as np
import pytest

from etd_ros.boxes import Box
from etd_ros.recovery import Found
from etd_ros.recovery.training.comparison import End, outcome_of, row_of, table
from etd_ros.recovery.training.episodes import Episode, episodes
from etd_ros.recovery.training.sequences import Sequence

COUNT, LOST, FIRST, SEEN = 60, 20, 25, 30


def episode(*, returns: bool = True) -> Episode:
    """A target that moves a pixel an image, is lost on image 20, searched from 25 on and seen again from 30 on."""
    boxes = np.zeros((COUNT, 1, 4), np.float32)
    boxes[:, 0] = [(index, 40, 20, 20) for index in range(COUNT)]
    visible = np.ones((COUNT, 1), np.float32)
    visible[LOST : SEEN if returns else COUNT] = 0
    images = np.zeros((COUNT, 90, 120), np.uint8)
    images[:, 0, 0] = np.arange(COUNT)
    return Episode("made up", Sequence(images, 0.01 * np.arange(COUNT), boxes, visible), 0, LOST, FIRST, returns)


class Answering:
    """Answers an image, whose number is its first pixel, with a shifted truth."""

    has_lead = False

    def __init__(self, number: int, shift: float) -> None:
        self.number, self.shift = number, shift
        self.remembered: list[tuple[int, Box]] = []
        self.last_boxes: set[Box] = set()

    def remember(self, image, box) -> None:
        self.remembered.append((int(image[0, 0]), box))

    def search(self, image, last_box) -> Found | None:
        self.last_boxes.add(last_box)
        number = int(image[0, 0])
        return Found(Box(number + self.shift, 40, 20, 20), 0.9) if number == self.number else None

    def look_wider(self):
        pass

    def watch(self):
        return None


def test_a_right_recovery_is_timed_from_where_the_target_could_be_seen():
    tracker = Answering(number=37, shift=3)
    outcome = outcome_of(lambda: tracker, episode())
    assert outcome.end is End.RIGHT
    assert outcome.wait_images == 7
    assert outcome.wait_s == pytest.approx(0.07)
    assert len(outcome.costs_ms) == 37 - FIRST + 1
    assert [number for number, _ in tracker.remembered] == list(range(LOST))
    assert tracker.last_boxes == {Box(19, 40, 20, 20)}


def test_another_place_is_wrong_and_so_is_any_place_when_the_target_is_gone():
    assert outcome_of(lambda: Answering(37, shift=15), episode()).end is End.WRONG
    assert outcome_of(lambda: Answering(37, shift=0), episode(returns=False)).end is End.WRONG
    assert outcome_of(lambda: Answering(-1, shift=0), episode()).end is End.NOT_FOUND


def test_the_row_has_the_shares():
    ends = [outcome_of(lambda n=n: Answering(n, shift=0), episode()) for n in (31, 35, -1)]
    ends += [outcome_of(lambda: Answering(40, shift=18), episode())]
    ends += [outcome_of(lambda n=n: Answering(n, shift=0), episode(returns=False)) for n in (-1, -1, 50, -1)]
    row = row_of("made up", ends)
    assert (row.losses, row.recovered, row.wrong) == (4, 0.5, 0.25)
    assert (row.gone, row.false) == (4, 0.25)
    assert row.wait_images == 3
    assert row.wait_ms == pytest.approx(30)
    assert "| made up | 50.0% of 4 | 25.0% | 25.0% of 4 | 30 ms, 3 images |" in table([row])


def test_episodes_come_in_pairs_that_differ_by_the_target_alone():
    made = list(episodes(2))
    assert len(made) % 2 == 0
    assert made
    for back, gone in zip(made[::2], made[1::2], strict=True):
        assert back.returns
        assert not gone.returns
        assert (back.target, back.lost, back.first) == (gone.target, gone.lost, gone.first)
        assert 0 < back.lost <= back.first < len(back.sequence.images)
        np.testing.assert_array_equal(back.sequence.images[: back.first], gone.sequence.images[: back.first])
        assert not np.array_equal(back.sequence.images, gone.sequence.images)
        assert (back.sequence.visible[back.first :, back.target] >= 0.5).sum() >= 10
        assert (gone.sequence.visible[gone.first :, gone.target] == 0).all()
