"""Sequences, pairs and labels say where the target is."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch
from torch.nn import functional

from etd_ros.recovery.compact import (
    EXEMPLAR_SIDE,
    INSTANCE_SIDE,
    Compact,
    Response,
    boxes_of,
    place_centers,
    target_mask,
)
from etd_ros.recovery.training.config import AugmentationConfig
from etd_ros.recovery.training.errors import TrainingError
from etd_ros.recovery.training.loss import (
    Comparison,
    compare,
    correlated,
    generalised_iou,
    intersection_over_union,
    labels_of,
    losses_of,
)
from etd_ros.recovery.training.pairs import EXEMPLAR_DEVIATION_MIN, PairSampler
from etd_ros.recovery.training.sequences import SequenceCache, simulated_sequence

PLACES = 11
PLAIN = AugmentationConfig(box_noise=0.0, elsewhere=0.0, gain=0.0, noise_levels=0.0, scale=0.0, shift_px=0.0)


def test_a_seed_gives_one_sequence(sequence_folder):
    cached, anew = SequenceCache(sequence_folder).sequence(1), simulated_sequence(1)
    np.testing.assert_array_equal(cached.images, anew.images)
    np.testing.assert_array_equal(cached.boxes, anew.boxes)
    np.testing.assert_array_equal(cached.visible, anew.visible)
    np.testing.assert_array_equal(cached.stamps_s, anew.stamps_s)


def test_sequences_hold_pictures_of_things_that_move(sequence_folder):
    for seed in range(4):
        sequence = SequenceCache(sequence_folder).sequence(seed)
        count, things = sequence.visible.shape
        assert sequence.images.shape == (count, 180, 240)
        assert sequence.boxes.shape == (count, things, 4)
        assert (np.diff(sequence.stamps_s) > 0).all()
        # What a network may be shown is not faint; the rest of the scene may be even.
        on_things = [
            sequence.images[image, max(0, int(y)) : int(y + h), max(0, int(x)) : int(x + w)].std()
            for image, thing in np.argwhere(sequence.visible > 0.9)
            for x, y, w, h in [sequence.boxes[image, thing]]
        ]
        assert max(on_things) > EXEMPLAR_DEVIATION_MIN
        assert sequence.visible.max() > 0.9


def test_damaged_and_missing_sequences_are_named(sequence_folder, tmp_path):
    cache = SequenceCache(tmp_path)
    with pytest.raises(TrainingError, match="sequence 5 is missing"):
        cache.sequence(5)
    for name in ("0000001.images.npy", "0000001.boxes.npy"):
        content = (sequence_folder / name).read_bytes()
        (tmp_path / name).write_bytes(content[: len(content) // 2])
    with pytest.raises(TrainingError, match="sequence 1 is missing or damaged"):
        cache.sequence(1)
    (tmp_path / "0000001.images.npy").write_bytes((sequence_folder / "0000001.images.npy").read_bytes())
    (tmp_path / "0000001.boxes.npy").write_bytes((sequence_folder / "0000001.images.npy").read_bytes())
    with pytest.raises(TrainingError, match="not images and boxes of one sequence"):
        cache.sequence(1)


def test_a_batch_depends_on_its_generator_alone(sequence_folder):
    sampler = PairSampler(SequenceCache(sequence_folder).sequence)
    first, second = (sampler.batch(np.random.default_rng(3), np.arange(4), 8) for _ in range(2))
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a, b)
    other = sampler.batch(np.random.default_rng(4), np.arange(4), 8)
    assert not np.array_equal(first.windows, other.windows)


def test_without_augmentation_the_target_is_in_the_middle(sequence_folder):
    sampler = PairSampler(SequenceCache(sequence_folder).sequence, PLAIN)
    batch = sampler.batch(np.random.default_rng(0), np.arange(4), 16)
    assert batch.exemplars.shape == (16, EXEMPLAR_SIDE, EXEMPLAR_SIDE)
    assert batch.windows.shape == (16, INSTANCE_SIDE, INSTANCE_SIDE)
    np.testing.assert_allclose(batch.boxes[:, :2], INSTANCE_SIDE / 2, atol=1e-3)
    # A target fills half of its exemplar: its context is as wide as it is on both sides together.
    np.testing.assert_allclose(np.sqrt(batch.sizes.prod(1)), EXEMPLAR_SIDE / 2, rtol=0.1)


def test_mirroring_moves_boxes_with_their_pixels(sequence_folder):
    config = AugmentationConfig(box_noise=0.0, elsewhere=0.0, gain=0.0, noise_levels=0.0, scale=0.0, shift_px=30.0)
    sequence = SequenceCache(sequence_folder).sequence(0)
    marked = np.zeros_like(sequence.images)
    for image, boxes in zip(marked, sequence.boxes, strict=True):
        for x, y, w, h in boxes:
            image[max(0, round(y)) : max(0, round(y + h)), max(0, round(x)) : max(0, round(x + w))] = 255
    sampler = PairSampler(lambda _: dataclasses.replace(sequence, images=marked), config)
    batch = sampler.batch(np.random.default_rng(1), np.arange(1), 24)
    for window, (x, y, _, _), visible in zip(batch.windows, batch.boxes, batch.visible, strict=True):
        if visible > 0.9:
            assert window[int(np.clip(y, 0, 127)), int(np.clip(x, 0, 127))] > 127


def test_places_on_the_target_are_positive_and_those_off_it_negative():
    boxes, visible = torch.tensor([[64.0, 64.0, 32.0, 48.0]]), torch.tensor([1.0])
    labels = labels_of(boxes, visible, PLACES, PLACES)
    centers = place_centers(PLACES)
    assert centers[PLACES // 2] == INSTANCE_SIDE / 2
    offset_x, offset_y = (centers - 64).abs() / 32, ((centers - 64).abs() / 48)[:, None]
    farther = torch.maximum(offset_x, offset_y)
    assert torch.equal(labels.positive[0], farther < 0.25)
    assert torch.equal(labels.negative[0], farther > 0.5)


def test_a_target_between_the_places_has_the_nearest_one():
    labels = labels_of(torch.tensor([[68.0, 68.0, 9.0, 9.0]]), torch.tensor([1.0]), PLACES, PLACES)
    assert labels.positive.sum() >= 1


def test_hidden_targets_make_all_places_negative_and_half_hidden_ones_leave_theirs_out():
    boxes = torch.tensor([[64.0, 64.0, 32.0, 32.0]]).repeat(2, 1)
    labels = labels_of(boxes, torch.tensor([0.0, 0.3]), PLACES, PLACES)
    assert not labels.positive.any()
    assert labels.negative[0].all()
    assert not labels.negative[1, PLACES // 2, PLACES // 2]


def test_the_overlaps_are_those_of_boxes():
    box = torch.tensor([[10.0, 10.0, 4.0, 4.0]])
    others = torch.tensor([[10.0, 10.0, 4.0, 4.0], [12.0, 10.0, 4.0, 4.0], [20.0, 10.0, 4.0, 4.0]])
    boxes = box.expand(3, 4)
    torch.testing.assert_close(intersection_over_union(boxes, others), torch.tensor([1.0, 1 / 3, 0.0]))
    torch.testing.assert_close(generalised_iou(boxes, others), torch.tensor([1.0, 1 / 3, -24 / 56]))


def test_right_answers_cost_next_to_nothing_and_wrong_ones_much():
    boxes, sizes, visible = torch.tensor([[64.0, 64.0, 32.0, 32.0]]), torch.tensor([[32.0, 32.0]]), torch.ones(1)
    labels = labels_of(boxes, visible, PLACES, PLACES)
    changes = torch.zeros(1, 4, PLACES, PLACES)
    changes[:, 0] = (64 - place_centers(PLACES)) / 8
    changes[:, 1] = ((64 - place_centers(PLACES)) / 8)[:, None]
    assert torch.allclose(boxes_of(changes, sizes)[0, :, 0, 0], boxes[0])
    right = torch.where(labels.positive, 12.0, -12.0)
    none = torch.full_like(right, -12.0)
    good = losses_of(Comparison(Response(right, changes), none[None]), sizes, boxes, visible)
    bad = losses_of(Comparison(Response(-right, changes + 3), -none[None]), sizes, boxes, visible)
    assert float(good.total) < 0.01
    assert all(float(part) > 0.3 for part in bad)


@pytest.mark.parametrize(("pairs", "others"), [(2, 1), (3, 2), (8, 4)])
def test_each_exemplar_is_compared_with_its_own_window_and_with_others(pairs, others):
    torch.manual_seed(0)
    network = Compact().eval()
    exemplars, windows = 255 * torch.rand(pairs, 1, 64, 64), 255 * torch.rand(pairs, 1, 128, 128)
    sizes = torch.full((pairs, 2), 32.0)
    with torch.inference_mode():
        response, logits = compare(network, exemplars, sizes, windows)
        alone = network(exemplars, sizes, windows)
        torch.testing.assert_close(response, alone)
        assert len(logits) == others
        swapped = network(exemplars.roll(1, 0), sizes, windows)
        torch.testing.assert_close(logits[0], swapped.logits)


def test_products_of_matrices_correlate_as_the_network_does():
    torch.manual_seed(1)
    kernels, windows = torch.randn(6, 4, 3, 3), torch.randn(2, 4, 7, 9)
    products = correlated(kernels, windows)
    assert products.shape == (6, 4, 5, 7)
    for number, product in enumerate(products):
        convolved = functional.conv2d(windows[number % 2][None], kernels[number][:, None], groups=4)[0]
        torch.testing.assert_close(product, convolved)


def test_what_others_have_in_common_is_not_normalised_away():
    """The normalisation of a batch of its own would tell the network that the target is in none of its windows."""
    torch.manual_seed(0)
    network = Compact().train()
    seen = []
    network.score.head[1].register_forward_hook(lambda _, inputs, __: seen.append(len(inputs[0])))
    exemplars, windows = 255 * torch.rand(6, 1, 64, 64), 255 * torch.rand(6, 1, 128, 128)
    compare(network, exemplars, torch.full((6, 2), 32.0), windows)
    assert seen == [30]


def test_the_mask_is_the_share_of_each_cell_under_the_box():
    mask = target_mask(torch.tensor([[32.0, 20.0]]))[0, 0]
    assert float(mask.sum()) == pytest.approx(32 * 20 / 64)
    assert mask[3, 3] == 1
    assert mask[2, 3] == pytest.approx(2 / 8)
    assert mask[0, 0] == 0
