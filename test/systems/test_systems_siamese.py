"""SiamFC and DaSiamRPN as compared systems."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from etd_ros.boxes import Box
from etd_ros.recovery import making
from etd_ros.recovery.siamrpn import SiamRpn
from etd_ros.settings import settings_from_mapping
from etd_ros.systems.interface import CompareError
from etd_ros.systems.siamese import dasiamrpn_maker, siamfc_maker

MAKERS = pytest.mark.parametrize(
    ("maker", "parameter"), [(siamfc_maker, "recovery.siamfc_model"), (dasiamrpn_maker, "recovery.siamrpn_model")]
)
DEFAULTS = settings_from_mapping({})


def pictures(count: int) -> list[tuple[np.ndarray, Box]]:
    """A board of random squares that moves three pixels a picture over a darker one."""
    rng = np.random.default_rng(0)
    board = rng.integers(60, 255, (6, 7)).astype(np.uint8).repeat(6, 0).repeat(6, 1)
    ground = rng.integers(20, 120, (20, 30)).astype(np.uint8).repeat(8, 0).repeat(8, 1)
    frames = []
    for index in range(count):
        x, y = 40 + 3 * index, 50 + index
        image = ground.copy()
        image[y : y + 36, x : x + 42] = board
        frames.append((image, Box(x, y, 42, 36)))
    return frames


@MAKERS
def test_out_of_the_box_it_follows_what_moves(maker, parameter):
    del parameter
    make = maker(DEFAULTS)
    (first, start), *others = pictures(20)
    tracker = make()
    tracker.start(first, start)
    overlaps = []
    for image, box in others:
        answer = tracker.update(image)
        assert answer.box is not None
        assert 0 <= answer.score <= 1
        overlaps.append(answer.box.iou(box))
    assert np.mean(overlaps) > 0.6


@MAKERS
def test_pictures_may_be_reused_by_the_caller(maker, parameter):
    del parameter
    make = maker(DEFAULTS)
    (first, start), (second, _) = pictures(2)
    kept, reused = make(), make()
    kept.start(first, start)
    shown = first.copy()
    reused.start(shown, start)
    shown[:] = second
    assert reused.update(shown) == kept.update(second)


@MAKERS
def test_files_that_are_no_weights_are_refused_in_one_line(maker, parameter, tmp_path):
    path = tmp_path / "weights.pth"
    path.write_bytes(b"nothing")
    with pytest.raises(CompareError, match=r"weights\.pth: not a file of plain weights"):
        maker(settings_from_mapping({parameter: str(path)}))
    with pytest.raises(CompareError, match=rf"no readable file; set the parameter {parameter}"):
        maker(settings_from_mapping({parameter: str(tmp_path / "gone.pth")}))


def test_each_others_files_are_refused(tmp_path):
    path = tmp_path / "SiamRPNVOT.model"
    torch.save(SiamRpn().state_dict(), path)
    with pytest.raises(CompareError, match=r"SiamFC's is .*: give siamfc_alexnet_e50\.pth"):
        siamfc_maker(settings_from_mapping({"recovery.siamfc_model": str(path)}))


@MAKERS
def test_without_torch_it_says_how_to_get_it(maker, parameter, monkeypatch):
    del parameter
    monkeypatch.setattr(making, "find_spec", lambda _: None)
    with pytest.raises(CompareError, match="needs torch and safetensors: pip install torch safetensors"):
        maker(DEFAULTS)


@MAKERS
def test_makers_share_one_network(maker, parameter):
    del parameter
    first, second = (maker(DEFAULTS)()._tracker for _ in range(2))
    name = "_network" if maker is siamfc_maker else "_matcher"
    assert getattr(first, name) is getattr(second, name)
