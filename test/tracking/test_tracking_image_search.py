"""A lost target is searched for on images beside the frames; who must not wait goes on without the answer."""

import math
import threading

import numpy as np
import pytest

from etd_ros.boxes import Box
from etd_ros.recovery import Found
from etd_ros.tracking.drift_watch import ANSWER_MAX_NS, ANSWER_NS, FIRST_IMAGES
from etd_ros.tracking.image_search import IMAGES, REMEMBER_NS, SOON_NS, ImageSearch
from etd_ros.tracking.target import TargetState
from etd_ros.tracking.turns import FEW, IMAGE_NS, MORE, PATIENCE_MAX, SEARCHES_MAX, WATCH_NS, Turns

IMAGE = np.zeros((20, 30), np.uint8)
BOX = Box(3, 4, 5, 6)
DUE_NS = SOON_NS


class SlowRecovery:
    """Finds the target once it is let."""

    def __init__(self):
        self.may_answer = threading.Event()
        self.searches = 0
        self.remembered = []
        self.has_lead = False
        self.widened = 0

    def remember(self, image, box):
        self.remembered.append(box)

    def search(self, image, last_box):
        self.searches += 1
        self.may_answer.wait()
        return Found(BOX, 0.9)

    def watch(self):
        return None

    def look_wider(self):
        self.widened += 1


class WatchedRecovery(SlowRecovery):
    """Is followed by another that answers at once."""

    def __init__(self, elsewhere):
        super().__init__()
        self.watching = SlowRecovery()
        self.watching.may_answer.set()
        self.watching.search = lambda image, last_box: elsewhere

    def watch(self):
        return self.watching

    def forget_lately(self):
        self.remembered.clear()


class Searches:
    """Of many targets that are lost together, and not found.

    Attributes:
        counts: how many images were searched for each.
    """

    def __init__(self, targets, state):
        self.counts, self._state, turns = [0] * targets, state, Turns()
        self._images = []
        for number in range(targets):
            recovery = SlowRecovery()
            recovery.search = lambda *_, number=number: self._count(number)
            self._images.append(ImageSearch(recovery, math.inf, turns))
            self._images[-1].begin(0)

    def take(self, images):
        for number in range(1, images + 1):
            for target in self._images:
                target.found(number * IMAGE_NS, IMAGE, self._state, BOX)
        for target in self._images:
            if target._searched is not None:
                end_of_search(target)

    def _count(self, number):
        self.counts[number] += 1


@pytest.fixture
def recovery():
    recovery = SlowRecovery()
    yield recovery
    recovery.may_answer.set()


def found(images, searches):
    """What the search of so many images in a row finds with the last of them."""
    answer = None
    for number in range(1, searches + 1):
        answer = images.found(number * DUE_NS, IMAGE, TargetState.RECOVERING, BOX)
    return answer


def end_of_search(images):
    images._searched.answer()


def test_an_answer_counts_from_the_next_search_on_however_long_it_took(recovery):
    images = ImageSearch(recovery, math.inf)
    images.begin(0)
    assert found(images, 1) is None
    threading.Timer(0.05, recovery.may_answer.set).start()
    assert images.found(2 * DUE_NS, IMAGE, TargetState.RECOVERING, BOX) == Found(BOX, 0.9)


def test_who_must_not_wait_goes_on_and_asks_nothing_else_meanwhile(recovery):
    images = ImageSearch(recovery, 0.0)
    images.begin(0)
    assert found(images, 5) is None
    recovery.may_answer.set()
    end_of_search(images)
    assert recovery.searches == 1
    assert images.found(6 * DUE_NS, IMAGE, TargetState.RECOVERING, BOX) == Found(BOX, 0.9)


def test_what_may_be_a_lost_target_is_looked_at_again_soon(recovery):
    images = ImageSearch(recovery, math.inf)
    recovery.may_answer.set()
    recovery.search = lambda *_: None
    lost_ns = Turns().wait_ns(1, IMAGES[TargetState.LOST])
    images.begin(0)
    images.found(lost_ns, IMAGE, TargetState.LOST, BOX)
    searched = []
    recovery.search = lambda *_: searched.append(True)
    images.found(lost_ns + DUE_NS, IMAGE, TargetState.LOST, BOX)
    assert not searched
    recovery.has_lead = True
    images.found(lost_ns + DUE_NS, IMAGE, TargetState.LOST, BOX)
    end_of_search(images)
    assert searched


def test_nothing_is_remembered_while_an_image_is_searched(recovery):
    images = ImageSearch(recovery, 0.0)
    images.begin(0)
    found(images, 1)
    images.remember(2 * REMEMBER_NS, IMAGE, BOX, is_sure=True)
    assert not recovery.remembered
    recovery.may_answer.set()
    end_of_search(images)
    images.remember(3 * REMEMBER_NS, IMAGE, BOX, is_sure=True)
    assert recovery.remembered == [BOX]


def test_an_answer_about_an_earlier_loss_does_not_count(recovery):
    images = ImageSearch(recovery, 0.0)
    images.begin(0)
    found(images, 1)
    images.begin(2 * DUE_NS)
    recovery.may_answer.set()
    end_of_search(images)
    assert images.found(3 * DUE_NS, IMAGE, TargetState.RECOVERING, BOX) is None
    end_of_search(images)
    assert images.found(4 * DUE_NS, IMAGE, TargetState.RECOVERING, BOX) == Found(BOX, 0.9)


def followed(elsewhere, turns=None):
    """A search of a target that has been followed for long enough to know what it looked like at first."""
    recovery = WatchedRecovery(elsewhere)
    images = ImageSearch(recovery, math.inf, turns)
    for number in range(1, FIRST_IMAGES + 1):
        assert not images.watch.knows_first
        assert images.watch.elsewhere(number * REMEMBER_NS, IMAGE, BOX) is None
        images.remember(number * REMEMBER_NS, IMAGE, BOX, is_sure=True)
    assert images.watch.knows_first
    return images, recovery


FOLLOWED_NS = FIRST_IMAGES * REMEMBER_NS
FAR = Found(BOX._replace(x=20), 0.9)


def test_what_is_seen_elsewhere_counts_once_the_search_has_had_its_time():
    images, _ = followed(FAR)
    assert images.watch.elsewhere(FOLLOWED_NS, IMAGE, BOX) is None
    assert images.watch.elsewhere(FOLLOWED_NS + ANSWER_NS - 1, None, BOX) is None
    assert images.watch.elsewhere(FOLLOWED_NS + ANSWER_NS, None, BOX) == FAR
    assert images.watch.elsewhere(FOLLOWED_NS + 2 * ANSWER_NS, None, BOX) is None


def test_what_was_remembered_of_something_else_is_forgotten_then():
    images, recovery = followed(FAR)
    images.watch.elsewhere(FOLLOWED_NS, IMAGE, BOX)
    images.watch.elsewhere(FOLLOWED_NS + ANSWER_NS, None, BOX)
    assert recovery.remembered
    images.forget_lately()
    assert not recovery.remembered


def test_what_was_seen_elsewhere_long_ago_does_not_count():
    images, _ = followed(FAR)
    images.watch.elsewhere(FOLLOWED_NS, IMAGE, BOX)
    assert images.watch.elsewhere(FOLLOWED_NS + ANSWER_MAX_NS + 1, None, BOX) is None
    assert images.watch.elsewhere(FOLLOWED_NS + ANSWER_MAX_NS + 2, None, BOX) is None


def test_an_image_that_comes_before_the_answer_is_remembered_and_the_answer_counts():
    images, recovery = followed(FAR)
    images.watch.elsewhere(FOLLOWED_NS, IMAGE, BOX)
    images.remember(FOLLOWED_NS + REMEMBER_NS, IMAGE, BOX, is_sure=True)
    assert len(recovery.remembered) == FIRST_IMAGES + 1
    assert images.watch.elsewhere(FOLLOWED_NS + REMEMBER_NS, IMAGE, BOX) == FAR


def test_what_is_found_after_an_early_loss_is_not_what_the_target_looked_like_at_first():
    images = ImageSearch(WatchedRecovery(FAR), math.inf)
    images.remember(REMEMBER_NS, IMAGE, BOX, is_sure=True)
    images.begin(2 * REMEMBER_NS)
    for number in range(3, 20):
        images.remember(number * REMEMBER_NS, IMAGE, BOX, is_sure=True)
    assert not images.watch.knows_first
    assert images.watch.elsewhere(20 * REMEMBER_NS, IMAGE, BOX) is None


@pytest.mark.parametrize("seen", [None, Found(BOX._replace(x=4), 0.9)])
def test_what_is_seen_in_its_box_or_not_at_all_is_not_elsewhere(seen):
    images, _ = followed(seen)
    images.watch.elsewhere(FOLLOWED_NS, IMAGE, BOX)
    assert images.watch.elsewhere(FOLLOWED_NS + ANSWER_NS, None, BOX) is None


def test_what_was_in_its_box_then_has_not_drifted_when_the_box_has_moved_on():
    images, _ = followed(Found(BOX, 0.9))
    images.watch.elsewhere(FOLLOWED_NS, IMAGE, BOX)
    assert images.watch.elsewhere(FOLLOWED_NS + ANSWER_NS, None, FAR.box) is None


def test_only_the_first_images_are_remembered_for_that():
    images, recovery = followed(None)
    images.remember(FOLLOWED_NS + REMEMBER_NS, IMAGE, BOX, is_sure=True)
    assert len(recovery.watching.remembered) == FIRST_IMAGES
    assert len(recovery.remembered) == FIRST_IMAGES + 1


@pytest.mark.parametrize("interrupt", [ImageSearch.begin, ImageSearch.time_went_back])
def test_what_was_seen_elsewhere_before_a_loss_or_a_new_start_does_not_count(interrupt):
    images, _ = followed(FAR)
    images.watch.elsewhere(FOLLOWED_NS, IMAGE, BOX)
    interrupt(images, FOLLOWED_NS + 1)
    assert images.watch.elsewhere(FOLLOWED_NS + 1 + ANSWER_NS, None, BOX) is None


@pytest.mark.parametrize("targets", [1, 2, 5])
def test_targets_take_turns_one_at_a_time(targets):
    turns, last = Turns(), [None] * targets
    taken = []
    for number in range(12 * targets):
        given = [turns.take((number + 1) * WATCH_NS, turn) for turn in last]
        (mine,) = [index for index, turn in enumerate(given) if turn is not None]
        last[mine] = given[mine]
        taken.append(mine)
    settled = taken[2 * targets :]
    assert all(settled.count(index) == len(settled) / targets for index in range(targets))


def test_a_turn_goes_on_when_a_target_no_longer_asks():
    turns = Turns()
    first = turns.take(WATCH_NS, None)
    assert first is not None
    assert turns.take(2 * WATCH_NS, first) is not None


def test_no_turn_is_given_soon_after_another():
    turns = Turns()
    assert turns.take(WATCH_NS, None) is not None
    assert turns.take(2 * WATCH_NS - 1, None) is None
    assert turns.take(2 * WATCH_NS, None) is not None


@pytest.mark.parametrize(
    ("state", "targets", "times"),
    [
        (TargetState.RECOVERING, 1, 1),
        (TargetState.RECOVERING, SEARCHES_MAX, 1),
        (TargetState.RECOVERING, 3 * SEARCHES_MAX, 3),
        (TargetState.LOST, SEARCHES_MAX, 1),
        (TargetState.LOST, 8 * SEARCHES_MAX, 2),
    ],
)
def test_each_lost_target_is_looked_for_on_fewer_images_the_more_there_are(state, targets, times):
    searches = Searches(targets, state)
    searches.take(48)
    # On the first image nobody knows yet how many there are.
    assert all(abs(count - 48 / (IMAGES[state] * times)) <= 1 for count in searches.counts)


@pytest.mark.parametrize(("targets", "patience"), [(0, 1), (1, 1), (FEW, 1), (FEW + MORE, 2), (100, PATIENCE_MAX)])
def test_contours_wait_longer_for_a_look_where_there_are_many(targets, patience):
    turns = Turns()
    turns.share_among(targets)
    assert turns.patience == patience


def test_the_first_images_after_a_loss_are_not_those_of_others_alone():
    few, many = Searches(1, TargetState.RECOVERING), Searches(20, TargetState.RECOVERING)
    few.take(1)
    many.take(1)
    assert few.counts == [1]
    assert set(many.counts) == {1}


@pytest.mark.parametrize("state", list(IMAGES))
def test_what_was_found_counts_on_the_next_image_however_many_are_lost(recovery, state):
    recovery.may_answer.set()
    turns = Turns()
    for _ in range(20):
        turns.wait_ns(IMAGE_NS, 1)
    images = ImageSearch(recovery, math.inf, turns)
    images.begin(0)
    assert images.found(IMAGE_NS * 100, IMAGE, state, BOX) is None
    assert images.found(IMAGE_NS * 101, IMAGE, state, BOX) == Found(BOX, 0.9)


def test_who_must_not_wait_goes_on_while_a_target_is_looked_for_elsewhere():
    recovery = WatchedRecovery(FAR)
    recovery.watching.search = recovery.search
    images = ImageSearch(recovery, 1000.0)
    for number in range(1, FIRST_IMAGES + 1):
        images.remember(number * REMEMBER_NS, IMAGE, BOX, is_sure=True)
    images.watch.elsewhere(FOLLOWED_NS, IMAGE, FAR.box)
    assert images.watch.elsewhere(FOLLOWED_NS + ANSWER_NS, None, FAR.box) is None
    recovery.may_answer.set()
    end_of_search(images.watch)
    assert images.watch.elsewhere(FOLLOWED_NS + 2 * ANSWER_NS, None, FAR.box) == Found(BOX, 0.9)


@pytest.mark.parametrize(("state", "widened"), [(TargetState.RECOVERING, 0), (TargetState.LOST, 3)])
def test_only_a_lost_target_is_looked_for_in_a_wider_region_with_each_search(recovery, state, widened):
    recovery.may_answer.set()
    recovery.search = lambda *_: None
    images = ImageSearch(recovery, math.inf)
    images.begin(0)
    for number in range(1, 4):
        images.found(number * Turns().wait_ns(1, IMAGES[state]), IMAGE, state, BOX)
        # No search is due.
        images.found(number * Turns().wait_ns(1, IMAGES[state]) + 1, IMAGE, state, BOX)
    assert recovery.widened == widened
