"""What the network that puts boxes right learns from: views along simulated tracks, and where the boxes should be."""

from __future__ import annotations

import dataclasses
import pickle
from collections import Counter

import numpy as np
import pytest
from recovery_boxes import BOX_SEEDS, SENSOR, put_right, view_of

from etd_ros.boxes import Box
from etd_ros.output_files import OutputError
from etd_ros.recovery.training.box_samples import (
    AGE_UNIT,
    FAR,
    POINTS_MAX,
    RANDOM_STREAM,
    START_NS,
    VIEWS_MAX,
    BoxSamples,
    Recorder,
    SampleCache,
    misfit_of,
    simulated_samples,
)
from etd_ros.recovery.training.box_scenes import KINDS, box_scene
from etd_ros.recovery.training.errors import TrainingError
from etd_ros.simulation import Path, Scene, SensorConfig, Sprite, Waypoint
from etd_ros.tracking.box_refinement import VIEW_MARGIN

ONE_TARGET, TWO_TARGETS = BOX_SEEDS
ROUNDING_PX = 1 / 16


def scene_and_sensor(seed: int) -> tuple[Scene, SensorConfig]:
    return box_scene(np.random.default_rng([RANDOM_STREAM, seed]))


def kind_of(scene: Scene) -> str:
    """By what differs: what is thrown, or stands in an extreme scene, is alone; others differ in how long they last."""
    if scene.targets == ("target",):
        return "extreme"
    return {1.0: "depth", 1.6: "random", 2.0: "shelf"}.get(float(scene.duration_s), "thrown")


def arrays_of(samples: BoxSamples) -> dict[str, np.ndarray]:
    return {field.name: getattr(samples, field.name) for field in dataclasses.fields(BoxSamples)}


def assert_same(samples: BoxSamples, others: BoxSamples) -> None:
    for name, array in arrays_of(samples).items():
        np.testing.assert_array_equal(array, getattr(others, name), strict=True, err_msg=name)


@pytest.fixture(scope="module", params=BOX_SEEDS)
def samples(request, box_folder) -> BoxSamples:
    return SampleCache(box_folder).samples(request.param)


@pytest.mark.parametrize("seed", range(8))
def test_a_generator_gives_one_scene_and_one_sensor(seed):
    (first, sensor), (again, sensor_again) = (scene_and_sensor(seed) for _ in range(2))
    assert sensor == sensor_again
    times_s = np.linspace(0, first.duration_s, 5)
    np.testing.assert_array_equal(first.placements(times_s), again.placements(times_s))
    np.testing.assert_array_equal(first.background, again.background)
    for sprite, other in zip(first.sprites, again.sprites, strict=True):
        np.testing.assert_array_equal(sprite.texture, other.texture)


def test_scenes_and_sensors_are_of_all_kinds():
    made = [scene_and_sensor(seed) for seed in range(60)]
    counts = Counter(kind_of(scene) for scene, _ in made)
    for kind, share in KINDS.items():
        assert counts[kind] == pytest.approx(60 * share, abs=4 * (60 * share * (1 - share)) ** 0.5), kind
        assert counts[kind] > 0, kind
    sensors = [sensor for _, sensor in made]
    assert 6 < sum(sensor.bandwidth_hz > 0 for sensor in sensors) < 32
    assert 16 < sum(sensor.threshold_bias != 0 for sensor in sensors) < 44


def test_a_seed_gives_one_folder_of_samples(box_folder):
    assert_same(SampleCache(box_folder).samples(ONE_TARGET), simulated_samples(ONE_TARGET))


def test_boxes_lie_near_the_right_ones_and_are_off_by_something(samples):
    views = [samples.view(number) for number in range(len(samples.counts))]
    off = np.array([misfit_of(view.box, truth) for view, truth in views])
    assert abs(off[:, :2]).max() < FAR
    assert 0.005 < abs(off).mean() < 0.3
    assert min(view.box.iou(truth) for view, truth in views) > 0.2


def test_a_target_has_only_so_many_views(box_folder):
    cache = SampleCache(box_folder)
    for seed, targets in ((ONE_TARGET, 1), (TWO_TARGETS, 2)):
        assert len(cache.samples(seed).counts) == targets * VIEWS_MAX


def test_the_right_boxes_are_the_scenes_at_the_times_of_the_views(box_folder):
    scene, _ = scene_and_sensor(ONE_TARGET)
    samples, times_s = SampleCache(box_folder).samples(ONE_TARGET), np.arange(0, scene.duration_s, 1e-5)
    knots_s = np.append(np.arange(0, scene.duration_s, 1e-3), scene.duration_s)
    knots = np.array([scene.box(scene.targets[0], time_s) for time_s in knots_s])
    boxes = np.column_stack([np.interp(times_s, knots_s, side) for side in knots.T])
    ages_s = samples.motions[:, 4].astype(float)
    assert (np.diff(ages_s) > 0).all()
    start_s = times_s[abs(boxes - samples.truths[0]).sum(1).argmin()] - ages_s[0]
    assert 0 < start_s < scene.duration_s / 2
    expected = boxes[np.rint((start_s + ages_s) / 1e-5).astype(int)]
    np.testing.assert_allclose(samples.truths, expected, atol=0.1)
    assert np.ptp(samples.truths[:, 0]) > 50


def test_points_lie_in_what_is_looked_at_and_are_as_old_as_its_span_at_most(samples):
    for number in range(len(samples.counts)):
        view, _ = samples.view(number)
        assert view.sensor == SENSOR
        beside = abs(view.points[:, :2] - np.array(view.box.center)) - VIEW_MARGIN / 2 * np.array(view.box[2:])
        assert beside.max() < 1 + ROUNDING_PX
        assert (view.points[:, :2] > -ROUNDING_PX).all()
        assert (view.points[:, :2] < np.array(SENSOR) + ROUNDING_PX).all()
        assert view.points[:, 2].min() >= 0
        assert 0.8 * view.span_s < view.points[:, 2].max() <= 1.0001 * view.span_s
        assert set(view.points[:, 3].tolist()) == {-1.0, 1.0}


def square_scene(*names: str) -> Scene:
    """Squares of 40 x 40 pixels round (120, 100) that stay there for half of the time, and go."""
    path = Path([Waypoint(0, 120, 100), Waypoint(0.5, 120, 100), Waypoint(1, 160, 140)])
    sprites = [Sprite(name, np.full((40, 40), 0.9), np.ones((40, 40)), path) for name in names]
    return Scene(*SENSOR, 1.0, np.full(SENSOR[::-1], 0.1), tuple(sprites))


TRUTH = square_scene("square").box("square", 0)
BESIDE = Box(TRUTH.x - 6, TRUTH.y + 3, TRUTH.w * 1.1, TRUTH.h * 0.9)


def recorded(*views) -> BoxSamples:
    rng = np.random.default_rng(0)
    recorder = Recorder(square_scene("square"), ["square"], rng)
    for view in views:
        recorder(view)
    return recorder.samples(rng)


def test_a_view_comes_back_as_the_recorder_was_asked_about_it():
    asked = [view_of(BESIDE, stamp_ns=START_NS, seed=seed, points=300 + seed) for seed in range(3)]
    samples = recorded(*asked)
    for number, view in enumerate(asked):
        back, truth = samples.view(number)
        np.testing.assert_allclose(truth, TRUTH, atol=1e-4)
        np.testing.assert_allclose(back.points[:, :2], view.points[:, :2], atol=ROUNDING_PX)
        np.testing.assert_allclose(back.points[:, 2], view.points[:, 2], atol=AGE_UNIT * view.span_s)
        np.testing.assert_array_equal(back.points[:, 3], view.points[:, 3])
        np.testing.assert_allclose(back.box, view.box, rtol=1e-6)
        np.testing.assert_allclose(back.velocity, view.velocity)
        for name in ("usual", "first"):
            np.testing.assert_allclose(getattr(back, name), getattr(view, name), atol=2e-3)
        assert back.sensor == view.sensor
        assert (back.span_s, back.age_s, back.growing_per_s) == pytest.approx(
            (view.span_s, view.age_s, view.growing_per_s)
        )


def test_the_right_box_is_where_the_target_is_when_it_is_viewed():
    stamps_ns = [START_NS + time_ns for time_ns in (0, 700_000_000, 900_000_000)]
    samples = recorded(*(view_of(BESIDE, stamp_ns=stamp_ns) for stamp_ns in stamps_ns))
    scene = square_scene("square")
    np.testing.assert_allclose(samples.truths, [scene.box("square", time_s) for time_s in (0, 0.7, 0.9)], atol=1e-3)
    assert samples.truths[2, 0] > samples.truths[1, 0] + 1


def test_of_a_view_of_too_many_points_some_are_kept_from_all_over_it():
    view = view_of(BESIDE, stamp_ns=START_NS, points=2 * POINTS_MAX + 77)
    back, _ = recorded(view, view_of(BESIDE, stamp_ns=START_NS, points=9)).view(0)
    assert len(back.points) == POINTS_MAX
    evenly = np.linspace(0, len(view.points) - 2, POINTS_MAX).astype(int)
    for number, point in zip(evenly, back.points, strict=True):
        neighbours = view.points[max(0, number - 1) : number + 3]
        (same,) = np.flatnonzero((abs(neighbours - point)[:, :2] <= ROUNDING_PX).all(1))
        assert abs(neighbours[same, 2] - point[2]) <= AGE_UNIT * view.span_s
        assert neighbours[same, 3] == point[3]


def test_what_the_recorder_keeps_stays_as_it_was():
    """The arrays of a view are the tracker's, and change with its next look."""
    view = view_of(BESIDE, stamp_ns=START_NS)
    expected = recorded(view)
    rng = np.random.default_rng(0)
    recorder = Recorder(square_scene("square"), ["square"], rng)
    recorder(view)
    for array in (view.points, view.velocity, view.usual, view.first):
        array[:] = 7
    assert_same(recorder.samples(rng), expected)


def test_half_of_the_targets_are_put_right_nearly_and_the_others_left():
    names = [f"square {number}" for number in range(60)]
    recorder = Recorder(square_scene(*names), names, np.random.default_rng(1))
    misfit, righted = misfit_of(BESIDE, TRUTH), []
    for name in names:
        told = [recorder(view_of(BESIDE, points=1, target=name, stamp_ns=START_NS)) for _ in range(20)]
        offsets = np.array([one.offsets for one in told])
        if (offsets == 0).all():
            assert all((one.spreads == 1).all() for one in told)
            continue
        righted.append(offsets.mean(0) - misfit)
        # Differently each time, but as the target's boxes usually are off.
        assert 0.02 < (offsets - offsets.mean(0)).std() < 0.08
        assert abs(righted[-1]).max() < 0.15
        assert all((one.spreads < 0.1).all() for one in told)
    assert 18 < len(righted) < 42
    assert 0.02 < np.std(righted) < 0.05


def test_what_is_on_something_else_is_not_kept():
    def moved(part: float) -> Box:
        return Box(TRUTH.x + part * TRUTH.w, TRUTH.y, TRUTH.w, TRUTH.h)

    asked = [view_of(moved(part), stamp_ns=START_NS) for part in (FAR + 0.05, FAR - 0.05, -FAR - 0.05)]
    samples = recorded(*asked)
    np.testing.assert_allclose(samples.boxes, [asked[1].box], rtol=1e-6)
    assert len(recorded(asked[0]).counts) == 0


def test_of_many_views_some_of_each_target_are_kept_in_their_order():
    names, rng = ["square", "other"], np.random.default_rng(3)
    recorder = Recorder(square_scene(*names), names, rng)
    for number in range(2 * VIEWS_MAX):
        for name, side in zip(names, (40.0, 41.0), strict=True):
            recorder(view_of(Box(100 + number / 10, 80, side, 40), points=5, target=name, stamp_ns=START_NS))
    samples = recorder.samples(rng)
    assert samples.boxes[:, 2].tolist() == [40.0] * VIEWS_MAX + [41.0] * VIEWS_MAX
    for places in np.split(samples.boxes[:, 0], 2):
        assert (np.diff(places) > 0).all()
        assert np.ptp(places) > 0.15 * VIEWS_MAX


@pytest.mark.parametrize("box", [BESIDE, TRUTH, Box(200, 10, 5, 90)])
def test_a_box_that_is_moved_and_resized_by_its_misfit_is_the_right_one(box):
    misfit = misfit_of(box, TRUTH)
    assert misfit.dtype == np.float32
    np.testing.assert_allclose(put_right(box, misfit), TRUTH, rtol=1e-4)


def test_samples_are_made_once_and_read_back(tmp_path):
    cache = SampleCache(tmp_path / "new" / "folder")
    assert not cache.has(ONE_TARGET)
    cache.make(ONE_TARGET)
    assert cache.has(ONE_TARGET)
    (file,) = cache.folder.iterdir()
    written = file.stat()
    cache.make(ONE_TARGET)
    SampleCache(cache.folder).make(ONE_TARGET)
    assert [(path, path.stat().st_mtime_ns, path.stat().st_ino) for path in cache.folder.iterdir()] == [
        (file, written.st_mtime_ns, written.st_ino)
    ]
    assert_same(cache.samples(ONE_TARGET), simulated_samples(ONE_TARGET))
    file.unlink()
    assert cache.has(ONE_TARGET)
    assert not SampleCache(cache.folder).has(ONE_TARGET)


def test_a_pickled_cache_reads_the_files_itself(box_folder):
    cache = SampleCache(box_folder)
    samples = cache.samples(ONE_TARGET)
    pickled = pickle.dumps(cache)
    assert len(pickled) < 1000
    copy = pickle.loads(pickled)
    assert copy.folder == box_folder
    assert_same(copy.samples(ONE_TARGET), samples)


def damaged(content: bytes, way: str) -> bytes:
    middle, packing = len(content) // 2, content.index(b"PK\1\2") + 10
    return {
        "cut off": content[:middle],
        "empty": b"",
        "text": b"no samples",
        "other bytes": content[:middle] + bytes(64) + content[middle + 64 :],
        "another way of packing": content[:packing] + b"\x63" + content[packing + 1 :],
    }[way]


@pytest.mark.parametrize("way", ["cut off", "empty", "text", "other bytes", "another way of packing"])
def test_damaged_samples_are_named_in_one_line(box_folder, tmp_path, way):
    file = f"{ONE_TARGET:07}.box.npz"
    content = (box_folder / file).read_bytes()
    (tmp_path / file).write_bytes(damaged(content, way))
    assert (tmp_path / file).read_bytes() != content
    with pytest.raises(TrainingError) as failed:
        SampleCache(tmp_path).samples(ONE_TARGET)
    assert str(failed.value) == f"{tmp_path / file}: samples are missing or damaged: delete the file to make them anew"


def test_missing_parts_missing_files_and_folders_that_cannot_be_made_are_named(tmp_path):
    cache = SampleCache(tmp_path)
    with (tmp_path / "0000004.box.npz").open("wb") as file:
        np.savez(file, points=np.zeros((0, 4), np.int16))
    with (tmp_path / "0000006.box.npz").open("wb") as file:
        np.save(file, np.zeros(3))
    for seed in (4, 5, 6):
        with pytest.raises(TrainingError, match=f"^[^ ]*000000{seed}.box.npz: samples are missing or damaged"):
            cache.samples(seed)
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="file is no folder"):
        SampleCache(tmp_path / "file" / "cache").make(ONE_TARGET)
