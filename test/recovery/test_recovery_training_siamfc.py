"""SiamFC learns from what a simulated camera films."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch
from recovery_trainings import SHORT

from etd_ros.boxes import Box
from etd_ros.recovery.siamfc import load_siamfc
from etd_ros.recovery.siamfc_tracking import SMALL_GEOMETRY
from etd_ros.recovery.training.compact_lesson import CompactLesson
from etd_ros.recovery.training.config import VALIDATION_SEEDS
from etd_ros.recovery.training.errors import TrainingError
from etd_ros.recovery.training.following import follow, main, targets_of
from etd_ros.recovery.training.loop import Progress, Training, prepare
from etd_ros.recovery.training.pairs import PairSampler
from etd_ros.recovery.training.sequences import Sequence, SequenceCache
from etd_ros.recovery.training.siamfc_lesson import (
    CROPS,
    SiamFcLesson,
    balanced_logistic_loss,
    distances_cells,
)
from etd_ros.recovery.training.video import VIDEO, filmed, video_sequence
from etd_ros.simulation import Path, Scene, Sprite, Waypoint

MIDDLE = SMALL_GEOMETRY.instance_side / 2
SHORTER = dataclasses.replace(SHORT, steps=30, interval=15, validation_batches=2)


@pytest.fixture(scope="module")
def video_cache(tmp_path_factory) -> SequenceCache:
    """All that SHORT needs."""
    cache = SequenceCache(tmp_path_factory.mktemp("videos"), VIDEO)
    for seed in (*range(SHORT.sequences), VALIDATION_SEEDS):
        cache.make(seed)
    return cache


@pytest.fixture(autouse=True)
def _one_thread():
    prepare("cpu", 1, 1.0)


def test_a_seed_gives_one_video(video_cache):
    cached, anew = video_cache.sequence(1), video_sequence(1)
    for name in ("images", "stamps_s", "boxes", "visible"):
        np.testing.assert_array_equal(getattr(cached, name), getattr(anew, name))


def test_videos_and_reconstructions_share_a_folder_without_being_mixed_up(video_cache):
    other = SequenceCache(video_cache.folder)
    assert not other.has(1)
    with pytest.raises(TrainingError, match="sequence 1 is missing"):
        other.sequence(1)


def moving(speed_px_s: float) -> Scene:
    """A bright square that crosses a dark ground."""
    square = Sprite(
        "square",
        np.full((20, 20), 0.9),
        np.ones((20, 20)),
        Path([Waypoint(0, 20, 40), Waypoint(1, 20 + speed_px_s, 40)]),
    )
    return Scene(120, 80, 1.0, np.full((80, 120), 0.1), (square,))


def edge_width(sequence: Sequence, index: int) -> int:
    """Columns between dark and bright beside the square, in its middle row."""
    row = sequence.images[index, 40].astype(float)
    low, high = np.quantile(row, 0.1), row.max()
    return int(np.count_nonzero((row > low + 0.2 * (high - low)) & (row < low + 0.8 * (high - low))))


def test_boxes_are_where_the_square_is_on_the_frames():
    sequence = filmed(moving(60), np.random.default_rng(0))
    for image, (box,) in zip(sequence.images, sequence.boxes, strict=True):
        x, y, w, h = box
        inside = image[round(y + 3) : round(y + h - 3), round(x + 3) : round(x + w - 3)]
        assert inside.mean() > 2 * np.median(image)


def test_what_moves_fast_is_blurred_by_the_exposure():
    # Exposures differ: the longest of some cameras.
    slow, fast = (
        max(edge_width(filmed(moving(speed), np.random.default_rng(seed)), 1) for seed in range(10))
        for speed in (1, 900)
    )
    assert fast > slow + 5


def test_windows_follow_the_size_of_the_target(video_cache):
    config = dataclasses.replace(SiamFcLesson(video_cache, torch.device("cpu")).sampler._config, scale=0.0)
    sampler = PairSampler(video_cache.sequence, dataclasses.replace(config, shift_px=0.0, box_noise=0.0), CROPS)
    batch = sampler.batch(np.random.default_rng(0), np.arange(4), 16)
    assert batch.exemplars.shape == (16, 63, 63)
    assert batch.windows.shape == (16, 127, 127)
    np.testing.assert_allclose(batch.boxes[:, :2], MIDDLE, atol=1e-3)
    np.testing.assert_allclose(np.sqrt(batch.boxes[:, 2:].prod(1)), 63 / 2, rtol=0.1)


def test_the_middle_place_is_in_the_middle_of_the_window_and_the_others_a_stride_apart():
    distances = distances_cells(torch.tensor([[MIDDLE, MIDDLE, 30.0, 30.0], [MIDDLE + 8, MIDDLE - 4, 30.0, 30.0]]))
    assert distances.shape == (2, 17, 17)
    assert distances[0, 8, 8] == 0
    assert distances[0, 8, 11] == 3
    assert distances[1, 7, 10] == 0


def test_positive_and_negative_places_weigh_the_same():
    distances = distances_cells(torch.tensor([[MIDDLE, MIDDLE, 30.0, 30.0]]))
    near, visible = distances <= 2, torch.ones(1)
    assert near.sum() == 13
    right = torch.where(near, 20.0, -20.0)
    assert float(balanced_logistic_loss(right, distances, visible)) < 1e-6
    silent, shouting = torch.full_like(right, -2.0), torch.full_like(right, 2.0)
    expected = (np.log1p(np.exp(2)) + np.log1p(np.exp(-2))) / 2
    for logits in (silent, shouting):
        assert float(balanced_logistic_loss(logits, distances, visible)) == pytest.approx(expected, rel=1e-5)


def test_hidden_targets_make_all_places_negative():
    distances = distances_cells(torch.tensor([[MIDDLE, MIDDLE, 30.0, 30.0]]))
    logits = torch.full_like(distances, -20.0)
    assert float(balanced_logistic_loss(logits, distances, torch.zeros(1))) < 1e-6
    assert float(balanced_logistic_loss(logits, distances, torch.ones(1))) > 9


def run(training: Training, **options) -> list[Progress]:
    progress: list[Progress] = []
    training.run(progress.append, **options)
    return progress


def test_a_short_training_lowers_the_loss_and_goes_on_as_if_it_had_not_stopped(video_cache, tmp_path):
    def training(name: str) -> Training:
        return Training(SHORTER, video_cache, tmp_path / name, make_lesson=SiamFcLesson)

    straight = training("straight")
    progress = run(straight)
    figures = [item.figures for item in progress if item.figures is not None]
    assert progress[-1].loss < 0.8 * progress[0].loss
    assert figures[1].loss < figures[0].loss
    run(training("stopped"), until=15)
    resumed = training("stopped")
    resumed.resume()
    assert resumed.step == 15
    run(resumed)
    for name, value in straight.network.state_dict().items():
        assert torch.equal(value, resumed.network.state_dict()[name]), name
    loaded = load_siamfc(tmp_path / "stopped" / "siamfc.safetensors").state_dict()
    assert torch.equal(loaded["backbone.conv1.0.weight"], straight.network.state_dict()["backbone.conv1.0.weight"])


def test_the_checkpoint_of_another_network_is_refused(video_cache, tmp_path):
    run(Training(SHORTER, video_cache, tmp_path, make_lesson=SiamFcLesson), until=1)
    with pytest.raises(TrainingError, match="was made with another network"):
        Training(SHORTER, video_cache, tmp_path, make_lesson=CompactLesson).resume()


class Perfect:
    """Answers with the truth, or half a box beside it."""

    def __init__(self, sequence: Sequence, target: int, shift: float = 0.0) -> None:
        self._boxes, self._shift = iter(sequence.boxes[:, target]), shift

    def start(self, picture, box) -> None:
        del picture
        assert box == Box(*next(self._boxes).tolist())

    def update(self, picture):
        del picture
        x, y, w, h = next(self._boxes).tolist()
        return Box(x + self._shift * w, y, w, h), 1.0


def test_followings_are_scored_where_the_target_can_be_seen():
    sequence = filmed(moving(60), np.random.default_rng(0))
    assert list(targets_of(sequence)) == [0]
    assert follow(Perfect(sequence, 0), sequence, 0).overlaps == (1.0,) * (len(sequence.images) - 1)
    beside = follow(Perfect(sequence, 0, shift=0.5), sequence, 0)
    np.testing.assert_allclose(beside.overlaps, 1 / 3)
    hidden = dataclasses.replace(sequence, visible=np.where(np.arange(len(sequence.images)) > 10, 0.2, 1.0)[:, None])
    assert len(follow(Perfect(hidden, 0), hidden, 0).overlaps) == 10


def test_the_table_has_a_row_for_each_tracker(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["following", "--scenes", "1"])
    main()
    header, _, *rows = capsys.readouterr().out.splitlines()
    assert header == "| tracker | AP | AR | ms a picture | targets |"
    assert [row.split("|")[1].strip() for row in rows] == ["siamfc, shipped", "dasiamrpn, compact"]
    for row in rows:
        ap, ar, cost_ms, targets = (float(cell) for cell in row.split("|")[2:6])
        assert 0 <= min(ap, ar) <= max(ap, ar) <= 1
        assert cost_ms > 0
        assert targets >= 1
