"""The network that puts boxes right is taught truths, learns them, and says the same where it is used."""

from __future__ import annotations

import dataclasses
import itertools
import math
import pickle
import shutil
from collections.abc import Iterable

import numpy as np
import pytest
import torch
from recovery_boxes import BOX_SEEDS, SENSOR, put_right, view_of

from etd_ros.boxes import Box
from etd_ros.recovery.training.box_lesson import (
    BoxBatch,
    BoxLesson,
    BoxSampler,
    BoxTensors,
    told_otherwise,
    turned_over,
)
from etd_ros.recovery.training.box_samples import SampleCache, misfit_of
from etd_ros.recovery.training.errors import TrainingError
from etd_ros.recovery.training.loop import prepare
from etd_ros.tracking import BoxView, TrackingError
from etd_ros.tracking.box_network import OFFSET_UNIT, SPREAD_UNIT, load_box_network, weight_shapes
from etd_ros.tracking.box_view import CELLS, CHANNELS, FIRST_CELLS, NUMBERS

ONE_TARGET, TWO_TARGETS = BOX_SEEDS
BORDER = (CELLS - FIRST_CELLS) // 2
BOX, TRUTH = Box(90, 60, 48, 30), Box(96, 55, 40, 36)
NO_SCENE = 7
"""A number of samples without a view."""


@pytest.fixture(autouse=True)
def _one_thread():
    prepare("cpu", 1, 1.0)


@pytest.fixture
def cache(box_folder) -> SampleCache:
    return SampleCache(box_folder)


@pytest.fixture
def lesson(cache) -> BoxLesson:
    torch.manual_seed(0)
    return BoxLesson(cache, torch.device("cpu"))


def batch_of(cache: SampleCache, seed: int, count: int = 16) -> BoxBatch:
    return BoxSampler(cache).batch(np.random.default_rng(seed), np.array([ONE_TARGET]), count)


# What the start box was told to be.


@pytest.mark.parametrize("seed", range(10))
def test_a_right_box_is_right_however_the_thing_was_told(seed):
    told, truth = told_otherwise(view_of(BOX), BOX, np.random.default_rng(seed))
    assert told.box != BOX
    np.testing.assert_allclose(misfit_of(told.box, truth), 0, atol=1e-6)


def test_the_right_box_is_told_as_the_same_part_of_the_thing_as_the_box():
    parts = []
    for seed in range(200):
        told, truth = told_otherwise(view_of(BOX, points=1), TRUTH, np.random.default_rng(seed))
        part, truths_part = misfit_of(BOX, told.box), misfit_of(TRUTH, truth)
        np.testing.assert_allclose(part, truths_part, atol=1e-5)
        parts.append(part)
    # It is not the thing's outline, but nearly.
    assert (np.std(parts, 0) > 0.02).all()
    assert (np.std(parts, 0) < 0.1).all()
    assert (abs(np.mean(parts, 0)) < 0.02).all()


@pytest.mark.parametrize("seed", range(10))
def test_usual_and_first_looks_stay_alike_when_told_otherwise(seed):
    view = view_of(BOX)
    view = dataclasses.replace(view, first=view.usual[:, BORDER:-BORDER, BORDER:-BORDER].copy())
    told, _ = told_otherwise(view, TRUTH, np.random.default_rng(seed))
    maps, _ = told.drawn(told.box, told.velocity)
    # What lies beyond the first look's border moves in from there.
    inside = slice(BORDER + 4, -BORDER - 4)
    np.testing.assert_allclose(maps[6:8, inside, inside], maps[8:10, inside, inside], atol=1e-4)
    assert abs(told.usual - view.usual).max() > 0.1


@pytest.mark.parametrize("seed", range(10))
def test_what_is_known_of_the_thing_lies_on_its_events_however_it_was_told(seed):
    """A spot that stands still, seen and known."""
    place = BOX.center[0] + 5, BOX.center[1] - 3
    across, down = np.meshgrid(np.arange(-13.5, 14, 3), np.arange(-9, 10, 2))
    points = np.column_stack([across.ravel() + place[0], down.ravel() + place[1], np.zeros(100), np.ones(100)])
    row, column = (np.mgrid[:CELLS, :CELLS] + 0.5) / CELLS
    known = (column - 0.5) * 2 * BOX.w + BOX.center[0] - place[0], (row - 0.5) * 2 * BOX.h + BOX.center[1] - place[1]
    usual = np.stack(3 * [np.exp(-(known[0] ** 2 + known[1] ** 2) / 8)]).astype(np.float32)
    view = dataclasses.replace(
        view_of(BOX), points=points.astype(np.float32), velocity=np.zeros(2), usual=usual,
        first=usual[:, BORDER:-BORDER, BORDER:-BORDER].copy(),
    )  # fmt: skip
    told, _ = told_otherwise(view, BOX, np.random.default_rng(seed))
    maps, _ = told.drawn(told.box, told.velocity)
    for layer in (maps[7], maps[9]):
        for axis in (0, 1):
            steps = np.arange(CELLS)
            seen, lies = (drawn.sum(axis) @ steps / drawn.sum() for drawn in (maps[:6].sum(0), layer))
            assert lies == pytest.approx(seen, abs=0.15)
    # The events moved on the grid, as the box did.
    assert abs(maps[:6].sum(0) - view.drawn(BOX, view.velocity)[0][:6].sum(0)).max() > 0.1


# Turning over.


def _mirrored(box: Box, axis: int) -> Box:
    x, y, w, h = box
    return Box(SENSOR[0] - x - w, y, w, h) if axis == 0 else Box(x, SENSOR[1] - y - h, w, h)


def mirrored(view: BoxView, axis: int) -> BoxView:
    """The view as in a mirror; `axis`: 0 where left is right, 1 where up is down."""
    points, velocity, sides = view.points.copy(), view.velocity.copy(), (slice(None), np.s_[::-1])
    points[:, axis], velocity[axis] = SENSOR[axis] - points[:, axis], -velocity[axis]
    way = (slice(None), sides[axis == 1], sides[axis == 0])
    usual, first = view.usual[way].copy(), view.first[way].copy()
    for maps in (usual, first):
        maps[axis] *= -1
    return dataclasses.replace(
        view, points=points, velocity=velocity, usual=usual, first=first, box=_mirrored(view.box, axis)
    )


def transposed(view: BoxView) -> BoxView:
    """The view with x for y."""
    usual, first = (maps[[1, 0, 2]].transpose(0, 2, 1).copy() for maps in (view.usual, view.first))
    x, y, w, h = view.box
    return dataclasses.replace(
        view, points=view.points[:, [1, 0, 2, 3]], velocity=view.velocity[::-1].copy(), usual=usual, first=first,
        sensor=view.sensor[::-1], box=Box(y, x, h, w),
    )  # fmt: skip


def in_negative(view: BoxView) -> BoxView:
    """The view of what is dark where that is bright."""
    opposite = np.array([-1, -1, 1], np.float32)[:, None, None]
    return dataclasses.replace(
        view,
        points=view.points * np.float32([1, 1, 1, -1]),
        usual=view.usual * opposite,
        first=view.first * opposite,
    )


def turned_by_hand(view: BoxView, box: Box, truth: Box, way: tuple[bool, ...]) -> tuple[np.ndarray, ...]:
    """The example of a view that is mirrored along x and y, transposed and in negative, where `way` says so."""
    for axis in (0, 1):
        if way[axis]:
            view, box, truth = mirrored(view, axis), _mirrored(box, axis), _mirrored(truth, axis)
    if way[2]:
        view = transposed(view)
        box, truth = (Box(one.y, one.x, one.h, one.w) for one in (box, truth))
    if way[3]:
        view = in_negative(view)
    return *view.drawn(box, view.velocity), misfit_of(box, truth)


def agree(example: tuple[np.ndarray, ...], other: tuple[np.ndarray, ...]) -> bool:
    return all(np.allclose(part, theirs, atol=2e-3) for part, theirs in zip(example, other, strict=True))


@pytest.mark.parametrize("place", [(90, 60), (5, 140)])
def test_an_example_that_is_turned_over_is_that_of_the_view_turned_over(place):
    """Whatever way it is turned, in all ways, each as often; near the sensor's border, too."""
    view, truth = view_of(Box(*place, 48, 30)), Box(place[0] + 6, place[1] - 5, 40, 36)
    # Nothing is known at the border: where a picture that is moved ends there is no matter of this test.
    view.usual[:, [0, -1]] = view.usual[:, :, [0, -1]] = 0
    # Off what is usual, so that this is moved, too.
    box = Box(view.box.x - 3, view.box.y + 2, 50, 27)
    example = (*view.drawn(box, view.velocity), misfit_of(box, truth))
    kept = [part.copy() for part in example]
    by_hand = {way: turned_by_hand(view, box, truth, way) for way in itertools.product((False, True), repeat=4)}
    seen = []
    for seed in range(300):
        turned = turned_over(*example, np.random.default_rng(seed))
        (way,) = (way for way, expected in by_hand.items() if agree(turned, expected))
        seen.append(way)
    assert set(seen) == set(by_hand)
    assert (abs(np.mean(seen, 0) - 0.5) < 0.12).all()
    for part, before in zip(example, kept, strict=True):
        np.testing.assert_array_equal(part, before)


# Batches.


def test_a_batch_depends_on_its_generator_alone(cache):
    seeds = np.array(BOX_SEEDS)
    sampler = BoxSampler(cache)
    first = sampler.batch(np.random.default_rng(3), seeds, 8)
    sampler.batch(np.random.default_rng(5), seeds, 8)
    copy = pickle.loads(pickle.dumps(sampler))
    for again in (sampler.batch(np.random.default_rng(3), seeds, 8), copy.batch(np.random.default_rng(3), seeds, 8)):
        for a, b in zip(first, again, strict=True):
            np.testing.assert_array_equal(a, b, strict=True)
    other = sampler.batch(np.random.default_rng(4), seeds, 8)
    for a, b in zip(first, other, strict=True):
        assert not np.array_equal(a, b)


def test_a_batch_is_finite_and_its_boxes_are_off_by_what_can_be_put_right(cache):
    batch = BoxSampler(cache).batch(np.random.default_rng(0), np.array(BOX_SEEDS), 64)
    assert batch.maps.shape == (64, CHANNELS, CELLS, CELLS)
    assert batch.numbers.shape == (64, NUMBERS)
    assert batch.misfits.shape == (64, 4)
    for part in batch:
        assert part.dtype == np.float32
        assert np.isfinite(part).all()
    assert 0.03 < abs(batch.misfits).mean() < 0.3
    assert abs(batch.misfits).max() < 1.5
    assert len(np.unique(batch.misfits, axis=0)) == 64


def test_scenes_of_which_nothing_was_followed_are_passed_over_but_not_if_there_are_no_others(box_folder, tmp_path):
    shutil.copy(box_folder / f"{ONE_TARGET:07}.box.npz", tmp_path)
    cache = SampleCache(tmp_path)
    samples = cache.samples(ONE_TARGET)
    nothing = {field.name: getattr(samples, field.name)[:0] for field in dataclasses.fields(samples)}
    with (tmp_path / f"{NO_SCENE:07}.box.npz").open("wb") as file:
        np.savez(file, **nothing)
    seeds = np.array([NO_SCENE, ONE_TARGET])
    batch = BoxSampler(cache).batch(np.random.default_rng(0), seeds, 16)
    assert np.isfinite(batch.misfits).all()
    with pytest.raises(TrainingError, match="nothing was followed in any of 1 simulated scenes"):
        BoxSampler(cache).batch(np.random.default_rng(0), seeds[:1], 16)


# Learning.


def learn(lesson: BoxLesson, batches: Iterable[BoxBatch]) -> list[float]:
    """A step on each; the losses before them."""
    optimiser = torch.optim.AdamW(lesson.network.parameters(), lr=0.004)
    losses = []
    for batch in batches:
        loss = lesson.losses(lesson.tensors(batch)).total
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(float(loss.detach()))
    return losses


def test_a_short_training_helps_with_examples_that_it_has_not_seen(lesson, cache):
    validation = [lesson.tensors(batch_of(cache, 1000, 64))]
    before = lesson.validate(validation)
    learn(lesson, (batch_of(cache, step) for step in range(40)))
    after = lesson.validate(validation)
    assert after.loss < before.loss - 0.08
    assert after.before == before.before
    assert after.after > before.after + 0.01


def test_a_few_examples_are_learnt_by_heart(lesson, cache):
    few = batch_of(cache, 0)
    losses = learn(lesson, [few] * 100)
    assert losses[-1] < losses[0] - 0.6
    figures = lesson.validate([lesson.tensors(few)])
    assert 1 - figures.after < 0.75 * (1 - figures.before)


def unknowing(lesson: BoxLesson, *offsets: float) -> None:
    """A network that says the same of all boxes."""
    with torch.no_grad():
        lesson.network.output.weight.zero_()
        lesson.network.output.bias.zero_()
        lesson.network.output.bias[: len(offsets)] = torch.tensor(offsets) / OFFSET_UNIT


def tensors_of(*misfits: tuple[float, ...]) -> BoxTensors:
    count = len(misfits)
    return BoxTensors(torch.rand(count, CHANNELS, CELLS, CELLS), torch.rand(count, NUMBERS), torch.tensor(misfits))


def test_the_figures_are_the_overlaps_of_boxes_as_they_are_and_put_right(lesson):
    # The right box lies half a width beside, and is twice as wide.
    batches = [tensors_of((0.5, 0, 0, 0)), tensors_of((0, 0, math.log(2), 0))]
    unknowing(lesson)
    figures = lesson.validate(batches)
    assert figures.before == figures.after == pytest.approx((1 / 3 + 1 / 2) / 2)
    unsure = math.exp(-SPREAD_UNIT)
    assert figures.loss == pytest.approx(SPREAD_UNIT + (0.5 + math.log(2)) * unsure / 8, rel=1e-5)
    unknowing(lesson, 0.25, 0, 0, 0)
    figures = lesson.validate(batches)
    assert (figures.before, figures.after) == pytest.approx((5 / 12, (0.75 / 1.25 + 1 / 2) / 2))
    assert figures.told() == f"loss {figures.loss:.3f}, mean IoU 0.4167 -> 0.5500"
    unknowing(lesson, 0.1, -0.2, 0.3, -0.4)
    assert lesson.validate([tensors_of((0.1, -0.2, 0.3, -0.4))]).after == pytest.approx(1)


def test_the_overlap_of_two_boxes_is_their_iou(lesson):
    misfit = misfit_of(BOX, TRUTH)
    unknowing(lesson, 0.1, 0.1, -0.1, 0.2)
    figures = lesson.validate([tensors_of(tuple(misfit.tolist()))])
    righted = put_right(BOX, np.array([0.1, 0.1, -0.1, 0.2]))
    assert (figures.before, figures.after) == pytest.approx((BOX.iou(TRUTH), righted.iou(TRUTH)), rel=1e-4)


def test_validation_leaves_nothing_out_and_the_training_some(lesson, cache):
    tensors = lesson.tensors(batch_of(cache, 0))
    first, again = (lesson.validate([tensors]) for _ in range(2))
    assert first == again
    assert lesson.network.training
    assert lesson.losses(tensors).total.item() != lesson.losses(tensors).total.item()


def test_a_box_that_is_far_off_does_not_decide_the_rest(lesson):
    unknowing(lesson)
    near, far = (lesson.losses(tensors_of((off, 0, 0, 0))).total.item() for off in (2.0, 200.0))
    assert near == far


# Weights.


def trained(lesson: BoxLesson) -> BoxLesson:
    """Weights of which none is 0, and outputs that differ by the example."""
    torch.manual_seed(5)
    with torch.no_grad():
        for parameter in lesson.network.parameters():
            parameter.add_(0.05 * torch.randn_like(parameter))
        lesson.network.output.weight.mul_(4)
    return lesson


def test_weights_are_read_back_as_they_were_written(lesson, cache, tmp_path):
    trained(lesson).save(tmp_path / "box.npz", {"steps": "40"})
    other = BoxLesson(cache, torch.device("cpu"))
    other.load(tmp_path / "box.npz")
    for name, parameter in lesson.network.state_dict().items():
        torch.testing.assert_close(other.network.state_dict()[name], parameter, rtol=1e-3, atol=1e-6)
    other.save(tmp_path / "again.npz", {"steps": "40"})
    with np.load(tmp_path / "box.npz") as file, np.load(tmp_path / "again.npz") as again:
        assert set(weight_shapes()) <= set(file.files)
        assert file["about"].tolist() == ["steps 40"]
        for name in file.files:
            np.testing.assert_array_equal(file[name], again[name], strict=True)


def test_weights_of_something_else_are_refused(lesson, tmp_path):
    (tmp_path / "box.npz").write_bytes(b"no weights")
    with pytest.raises(TrackingError, match="^[^ ]*box.npz: no weights of the box network"):
        lesson.load(tmp_path / "box.npz")


@pytest.mark.parametrize("seed", range(3))
def test_where_it_is_used_the_network_says_what_it_says_in_training(lesson, cache, tmp_path, seed):
    trained(lesson).save(tmp_path / "box.npz", {})
    network = load_box_network(tmp_path / "box.npz")
    batch = batch_of(cache, seed)
    lesson.network.eval()
    with torch.inference_mode():
        offsets, log_spreads = lesson.network(*(torch.from_numpy(part) for part in batch[:2]))
    assert offsets.std(0).min() > 0.01
    for number in range(16):
        misfit = network.misfit(batch.maps[number], batch.numbers[number])
        np.testing.assert_allclose(misfit.offsets, offsets[number], atol=2e-3)
        np.testing.assert_allclose(np.log(misfit.spreads), log_spreads[number], atol=1e-2)


def test_the_network_is_shown_what_it_was_taught(cache, lesson, tmp_path):
    """What it says of a view is what it says of its drawing."""
    trained(lesson).save(tmp_path / "box.npz", {})
    network = load_box_network(tmp_path / "box.npz")
    view, _ = cache.samples(ONE_TARGET).view(3)
    maps, numbers = view.drawn(view.box, view.velocity)
    lesson.load(tmp_path / "box.npz")
    lesson.network.eval()
    with torch.inference_mode():
        offsets, _ = lesson.network(torch.from_numpy(maps)[None], torch.from_numpy(numbers)[None])
    np.testing.assert_allclose(network.misfit_of(view).offsets, offsets[0], atol=1e-4)
