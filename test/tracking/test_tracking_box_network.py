"""The network that tells how far a box is off: its layers do what their definitions say, its file is read safely."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from scipy.signal import correlate

from etd_ros.tracking import TrackingError
from etd_ros.tracking.box_network import (
    WEIGHTS,
    BoxNetwork,
    convolve,
    load_box_network,
    read_weights,
    shipped_network,
    weight_shapes,
)
from etd_ros.tracking.box_view import CELLS, CHANNELS, NUMBERS


def weights_of(rng, scale=0.1):
    return {name: (scale * rng.standard_normal(shape)).astype(np.float32) for name, shape in weight_shapes().items()}


def written(tmp_path, weights):
    path = tmp_path / "box.npz"
    np.savez(path, **weights)
    return path


@pytest.mark.parametrize("step", [1, 2])
def test_a_convolution_is_the_correlation_of_all_channels_and_a_relu(step):
    rng = np.random.default_rng(step)
    layer = rng.standard_normal((3, 8, 8)).astype(np.float32)
    kernels = rng.standard_normal((8, 3, 3, 3)).astype(np.float32)
    biases = rng.standard_normal(8).astype(np.float32)
    padded = np.pad(layer, ((0, 0), (1, 1), (1, 1)))
    sums = np.array([correlate(padded, kernel, "valid")[0] for kernel in kernels])[:, ::step, ::step]
    expected = np.maximum(sums + biases[:, None, None], 0)
    assert convolve(layer, kernels.reshape(8, -1), biases, step) == pytest.approx(expected, abs=1e-4)


def test_a_network_without_weights_says_that_boxes_are_right_and_that_it_does_not_know():
    network = BoxNetwork({name: np.zeros(shape, np.float32) for name, shape in weight_shapes().items()})
    misfit = network.misfit(np.ones((CHANNELS, CELLS, CELLS), np.float32), np.ones(NUMBERS, np.float32))
    assert misfit.offsets.tolist() == [0, 0, 0, 0]
    assert misfit.spreads == pytest.approx([np.exp(-2.5)] * 4)


def test_spreads_have_limits():
    weights = {name: np.zeros(shape, np.float32) for name, shape in weight_shapes().items()}
    weights["output_bias"][4:] = 100, -100, 100, -100
    misfit = BoxNetwork(weights).misfit(np.zeros((CHANNELS, CELLS, CELLS), np.float32), np.zeros(NUMBERS, np.float32))
    assert misfit.spreads == pytest.approx(np.exp([1, -5, 1, -5]))


def test_a_file_gives_the_network_that_was_written(tmp_path):
    rng = np.random.default_rng(0)
    weights = weights_of(rng)
    maps = rng.random((CHANNELS, CELLS, CELLS)).astype(np.float32)
    numbers = rng.random(NUMBERS).astype(np.float32)
    read = load_box_network(written(tmp_path, weights)).misfit(maps, numbers)
    made = BoxNetwork(weights).misfit(maps, numbers)
    assert np.array_equal(read.offsets, made.offsets)
    assert np.array_equal(read.spreads, made.spreads)


def test_what_ships_is_small_and_is_read_once():
    assert WEIGHTS.stat().st_size < 300_000
    assert shipped_network() is shipped_network()


def test_a_file_that_is_no_archive_is_refused(tmp_path):
    path = tmp_path / "box.npz"
    path.write_bytes(b"weights")
    with pytest.raises(TrackingError, match=r"box\.npz: no weights of the box network"):
        read_weights(path)


def test_a_damaged_archive_is_refused(tmp_path):
    path = written(tmp_path, weights_of(np.random.default_rng(0)))
    path.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(TrackingError, match="no weights of the box network"):
        read_weights(path)


def test_an_archive_whose_packing_is_damaged_is_refused(tmp_path):
    content = bytearray(WEIGHTS.read_bytes())
    name = content.index(b"hidden.npy")
    packed = name + len(b"hidden.npy") + int.from_bytes(content[name - 2 : name], "little")
    # There are no blocks of this kind.
    content[packed] |= 0b110
    path = tmp_path / "box.npz"
    path.write_bytes(content)
    with pytest.raises(TrackingError, match=r"the box network \(it is damaged, or something else\): name"):
        read_weights(path)


def test_nobody_is_told_to_trust_a_file(tmp_path):
    path = tmp_path / "box.npz"
    for content in (b"weights", pickle.dumps({"hidden": 1}), b"<html>"):
        path.write_bytes(content)
        with pytest.raises(TrackingError) as refused:
            read_weights(path)
        assert str(refused.value) == (
            f"{path}: no weights of the box network (it is damaged, or something else): name a box.npz made by "
            "`train --network box`"
        )


def test_code_that_hides_in_a_file_is_not_run(tmp_path):
    weights = weights_of(np.random.default_rng(0)) | {"hidden": np.array([print], object)}
    with pytest.raises(TrackingError, match="no weights of the box network"):
        read_weights(written(tmp_path, weights))


def test_weights_that_are_missing_are_named(tmp_path):
    weights = weights_of(np.random.default_rng(0))
    del weights["output_bias"]
    with pytest.raises(TrackingError, match="output_bias"):
        read_weights(written(tmp_path, weights))


@pytest.mark.parametrize("wrong", [np.zeros((8, 3)), np.full((8, 64), np.nan)])
def test_weights_of_another_shape_or_that_are_no_numbers_are_refused(wrong, tmp_path):
    weights = weights_of(np.random.default_rng(0)) | {"output": wrong}
    with pytest.raises(TrackingError, match=r"weights output are not numbers of shape \(8, 64\)"):
        read_weights(written(tmp_path, weights))
