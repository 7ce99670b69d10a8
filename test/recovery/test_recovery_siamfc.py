"""SiamFC: the published network, its files, and the small one that ships, following targets."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from recovery_scenes import HEIGHT, WIDTH, picture, texture
from safetensors.torch import load_file, save_file

from etd_ros.boxes import Box
from etd_ros.recovery import RecoveryConfig, RecoveryError
from etd_ros.recovery.matchers import SiamFcMatcher
from etd_ros.recovery.picture_trackers import make_siamfc
from etd_ros.recovery.siamfc import PUBLISHED, SHIPPED, SMALL, SiamFc, load_siamfc
from etd_ros.recovery.siamfc_tracking import (
    PUBLISHED_GEOMETRY,
    SCALE_PENALTY,
    SCALE_RATE,
    SCALE_STEP,
    SMALL_GEOMETRY,
    SiamFcTracker,
)

OFFICIAL_SHAPES = {
    "backbone.conv1.0.weight": (96, 3, 11, 11),
    "backbone.conv1.1.running_var": (96,),
    "backbone.conv2.0.weight": (256, 48, 5, 5),
    "backbone.conv2.1.num_batches_tracked": (),
    "backbone.conv3.0.weight": (384, 256, 3, 3),
    "backbone.conv4.0.weight": (384, 192, 3, 3),
    "backbone.conv4.1.weight": (384,),
    "backbone.conv5.0.weight": (256, 192, 3, 3),
    "backbone.conv5.0.bias": (256,),
}
START = Box(60, 70, 40, 36)


def noise(side: int, channels: int, seed: int = 0) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(seed).uniform(0, 255, (1, channels, side, side))).float()


@pytest.fixture(scope="module")
def published() -> SiamFc:
    """With random weights."""
    torch.manual_seed(0)
    return SiamFc().eval()


@pytest.fixture(scope="module")
def model(published, tmp_path_factory) -> Path:
    """A file as the public re-implementation leaves it behind."""
    path = tmp_path_factory.mktemp("models") / "siamfc_alexnet_e50.pth"
    torch.save(published.state_dict(), path)
    return path


def test_the_published_network_has_the_published_names_shapes_and_parameters(published):
    state = published.state_dict()
    assert {name: tuple(state[name].shape) for name in OFFICIAL_SHAPES} == OFFICIAL_SHAPES
    assert len(state) == 5 * 2 + 4 * 5
    assert sum(value.numel() for value in published.parameters()) == 2_336_320


@pytest.mark.parametrize(("layout", "exemplar_cells", "window_cells"), [(PUBLISHED, 6, 22), (SMALL, 4, 20)])
def test_exemplar_and_instance_give_17_by_17_places(layout, exemplar_cells, window_cells):
    network, geometry, channels = SiamFc(layout).eval(), layout.geometry, layout.widths[0]
    with torch.inference_mode():
        kernels = network.features(noise(geometry.exemplar_side, channels))
        features = network.features(noise(geometry.instance_side, channels))
        assert kernels.shape == (1, layout.widths[-1], exemplar_cells, exemplar_cells)
        assert features.shape == (1, layout.widths[-1], window_cells, window_cells)
        assert network.respond(kernels, features).shape == (1, 17, 17)


PLACES = pytest.mark.parametrize(("column", "row"), [(0, 0), (3, -2), (-8, 8)])


@PLACES
def test_an_exemplar_looks_the_same_wherever_a_window_shows_it(published, column, row):
    window = noise(255, 3)
    left, top = 64 + 8 * column, 64 + 8 * row
    with torch.inference_mode():
        kernels = published.features(window[..., top : top + 127, left : left + 127])
        features = published.features(window)
        response = published.respond(kernels, features)[0]
    torch.testing.assert_close(features[..., 8 + row : 14 + row, 8 + column : 14 + column], kernels)
    assert float(response[8 + row, 8 + column]) == pytest.approx(0.001 * float((kernels**2).sum()), rel=1e-4)


@PLACES
def test_the_response_of_the_network_that_ships_peaks_where_the_exemplar_was_cut_from(column, row):
    matcher = SiamFcMatcher(load_siamfc())
    window = texture(4, 127, 127)
    left, top = 32 + 4 * column, 32 + 4 * row
    (response,) = matcher.responses([window], matcher.template(window[top : top + 63, left : left + 63]))
    peak = np.unravel_index(np.argmax(response), response.shape)
    # Half of a window's contrast may lie beyond an exemplar: each is brought to full contrast for itself.
    np.testing.assert_allclose(peak, (8 + row, 8 + column), atol=1)


def test_each_window_is_correlated_with_its_own_exemplar(published):
    exemplars = torch.cat([noise(127, 3, seed) for seed in (1, 2)])
    windows = torch.cat([noise(255, 3, seed) for seed in (3, 4)])
    with torch.inference_mode():
        both = published(exemplars, windows)
        alone = torch.cat([published(exemplars[index : index + 1], windows[index : index + 1]) for index in range(2)])
    torch.testing.assert_close(both, alone, rtol=1e-4, atol=1e-4)


def test_a_published_file_loads_as_it_is(published, model):
    loaded = load_siamfc(model)
    assert not loaded.training
    for name, value in published.state_dict().items():
        assert torch.equal(value, loaded.state_dict()[name]), name


def test_folding_the_normalisations_changes_no_answer(model):
    window = np.random.default_rng(5).integers(0, 256, (255, 255, 3)).astype(np.uint8)
    matcher = SiamFcMatcher(load_siamfc(model))
    answers = matcher.responses([window] * 3, matcher.template(window[64:191, 64:191]))
    network = load_siamfc(model)
    with torch.inference_mode():
        rgb = torch.from_numpy(window[..., ::-1].copy()).permute(2, 0, 1)[None].float()
        expected = network(rgb[..., 64:191, 64:191], rgb)[0]
    for answer in answers:
        np.testing.assert_allclose(answer, expected, rtol=1e-3, atol=1e-3)


def test_files_of_another_network_and_damaged_ones_are_refused_in_one_line(model, tmp_path):
    state = torch.load(model, weights_only=True)
    path = tmp_path / "odd.pth"
    torch.save({name: value for name, value in state.items() if name != "backbone.conv3.0.bias"}, path)
    with pytest.raises(
        RecoveryError, match=r"backbone\.conv3\.0\.bias is missing, SiamFC's is \(384,\): give siamfc_a"
    ):
        load_siamfc(path)
    torch.save({**state, "backbone.conv5.0.bias": torch.zeros(512)}, path)
    with pytest.raises(RecoveryError, match=r"backbone\.conv5\.0\.bias is \(512,\), SiamFC's is \(256,\)"):
        load_siamfc(path)
    torch.save({**state, "backbone.conv5.0.bias": torch.full((256,), torch.inf)}, path)
    with pytest.raises(RecoveryError, match="not finite"):
        load_siamfc(path)
    path.write_bytes(model.read_bytes()[:5000])
    with pytest.raises(RecoveryError, match=r"odd\.pth: not a file of plain weights"):
        load_siamfc(path)
    with pytest.raises(RecoveryError, match=r"gone\.pth: no readable file; set the parameter recovery.siamfc_model"):
        load_siamfc(tmp_path / "gone.pth")


def test_a_safetensors_file_of_another_network_is_refused(tmp_path):
    path = tmp_path / "siamfc.safetensors"
    save_file(load_file(SHIPPED), path, metadata={"network": "etd_ros siamfc 0"})
    with pytest.raises(RecoveryError, match="weights of another network than 'etd_ros siamfc 1'"):
        load_siamfc(path)


def test_what_ships_is_small():
    assert SHIPPED.stat().st_size < 3_000_000
    assert sum(value.numel() for value in load_siamfc().parameters()) == 234_016


class Answering:
    """A network whose response to a window is a bump at a place, as high as it is told."""

    geometry = PUBLISHED_GEOMETRY

    def __init__(self, *, column: float = 8, row: float = 8, heights: tuple[float, float, float] = (1, 2, 1)) -> None:
        rows, columns = np.mgrid[:17, :17]
        bump = np.exp(-((columns - column) ** 2 + (rows - row) ** 2) / 4)
        self._responses = (np.array(heights)[:, None, None] * bump).astype(np.float32)
        self.windows: list[np.ndarray] = []

    def template(self, exemplar):
        assert exemplar.shape[:2] == (127, 127)

    def responses(self, windows, template):
        self.windows = list(windows)
        return self._responses


def followed(network: Answering, pictures: int = 1) -> tuple[Box, float]:
    tracker = SiamFcTracker(network)
    image = picture((texture(1, 40, 36), START))
    tracker.start(image, START)
    for _ in range(pictures):
        answer = tracker.update(image)
    return answer


def test_a_peak_in_the_middle_keeps_the_box():
    box, score = followed(Answering())
    # The peak lies between the four places in the middle, of which one is taken.
    np.testing.assert_allclose(box, START, atol=0.2)
    assert score == pytest.approx(1 / (1 + np.exp(-2)), abs=1e-4)


def test_a_peak_beside_the_middle_moves_the_box_by_as_many_strides():
    box, _ = followed(Answering(column=9, row=7))
    scale = 127 / np.sqrt((40 + 38) * (36 + 38))
    np.testing.assert_allclose(box.center[0] - START.center[0], 8 / scale, rtol=0.1)
    np.testing.assert_allclose(box.center[1] - START.center[1], -8 / scale, rtol=0.1)


def test_of_two_equal_peaks_the_one_nearer_to_the_last_place_is_taken():
    network = Answering(column=14)
    network._responses += Answering(column=6)._responses
    assert followed(network)[0].center[0] < START.center[0]


def test_size_follows_the_likeliest_scale_at_a_rate_and_only_where_it_pays():
    larger, _ = followed(Answering(heights=(1.0, 2.0, 2.2)))
    assert larger.w / START.w == pytest.approx(1 + SCALE_RATE * (SCALE_STEP - 1))
    assert larger.w / larger.h == pytest.approx(START.w / START.h)
    smaller, _ = followed(Answering(heights=(2.2, 2.0, 1.0)))
    assert smaller.w / START.w == pytest.approx(1 + SCALE_RATE * (1 / SCALE_STEP - 1))
    kept, _ = followed(Answering(heights=(2.0, 2.0 * SCALE_PENALTY * 1.01, 2.0)))
    assert kept.w == pytest.approx(START.w)


def test_no_target_grows_beyond_five_times_its_size():
    assert followed(Answering(heights=(0, 1, 3)), pictures=100)[0].w == pytest.approx(5 * START.w)


def test_windows_are_shown_at_three_scales():
    network = Answering()
    followed(network)
    assert [window.shape for window in network.windows] == [(255, 255)] * 3
    sides = [int(np.sqrt(np.count_nonzero(window.astype(int) > 150))) for window in network.windows]
    assert sides[0] > sides[1] > sides[2]


def drifting(seed: int, *, colour: bool = False) -> list[tuple[np.ndarray, Box]]:
    """Thirty pictures of a textured sprite that crosses another texture and grows by a quarter."""
    sprite, ground = texture(seed, 60, 54), texture(seed + 100, WIDTH, HEIGHT) // 2 + 60
    frames = []
    for index in range(30):
        grown = 1 + 0.25 * index / 29
        w, h = round(40 * grown), round(36 * grown)
        box = Box(30 + 4 * index, 60 + round(10 * np.sin(index / 5)), w, h)
        image = picture((sprite, box), seed=index)
        outside = np.ones(image.shape, bool)
        outside[int(box.y) : int(box.y) + h, int(box.x) : int(box.x) + w] = False
        image[outside] = ground[outside]
        frames.append((np.repeat(image[..., None], 3, axis=2) if colour else image, box))
    return frames


@pytest.mark.parametrize("colour", [False, True])
def test_the_network_that_ships_follows_a_textured_sprite(colour):
    make = make_siamfc(RecoveryConfig())
    overlaps = []
    for seed in (1, 2, 3):
        (first, start), *others = drifting(seed, colour=colour)
        tracker = make()
        tracker.start(first, start)
        overlaps += [tracker.update(image)[0].iou(box) for image, box in others]
    assert np.mean(overlaps) > 0.6


def test_targets_share_a_network_and_nothing_else():
    make = make_siamfc(RecoveryConfig())
    first, second = make(), make()
    frames = drifting(1)
    first.start(*frames[0])
    second.start(frames[0][0], Box(150, 100, 20, 20))
    alone = make()
    alone.start(*frames[0])
    for image, _ in frames[1:4]:
        second.update(image)
        assert first.update(image) == alone.update(image)


def test_a_published_file_serves_a_tracker_on_colour_pictures(model):
    tracker = make_siamfc(RecoveryConfig(siamfc_model=str(model)))()
    image = np.random.default_rng(2).integers(0, 256, (120, 160, 3)).astype(np.uint8)
    tracker.start(image, Box(40, 40, 30, 20))
    box, score = tracker.update(image)
    assert all(np.isfinite(box))
    assert 0 <= score <= 1


def test_boxes_beyond_the_picture_are_survived():
    tracker = SiamFcTracker(SiamFcMatcher(load_siamfc()))
    image = texture(1, 64, 48)
    for box in (Box(-500, 0, 20, 20), Box(60, 40, 200, 0.5), Box(0, 0, 64, 48)):
        tracker.start(image, box)
        assert all(np.isfinite(tracker.update(image)[0]))
    assert SMALL_GEOMETRY.exemplar_side == 63
