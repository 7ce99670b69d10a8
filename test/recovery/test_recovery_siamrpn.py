"""DaSiamRPN's own files load, and nothing else does; no code in them is run."""

from __future__ import annotations

import os
import pickle
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import save_file
from torch.torch_version import TorchVersion

from etd_ros.boxes import Box
from etd_ros.recovery import RecoveryConfig, RecoveryError, make_recovery
from etd_ros.recovery.siamrpn import ANCHORS, SiamRpn, as_bgr, boxes_of, load_siamrpn
from etd_ros.recovery.weights_file import SHIPPED

OFFICIAL_SHAPES = {
    "featureExtract.0.weight": (96, 3, 11, 11),
    "featureExtract.1.running_var": (96,),
    "featureExtract.4.weight": (256, 96, 5, 5),
    "featureExtract.8.weight": (384, 256, 3, 3),
    "featureExtract.11.weight": (384, 384, 3, 3),
    "featureExtract.14.weight": (256, 384, 3, 3),
    "featureExtract.15.weight": (256,),
    "conv_r1.weight": (256 * 20, 256, 3, 3),
    "conv_r2.weight": (256, 256, 3, 3),
    "conv_cls1.weight": (256 * 10, 256, 3, 3),
    "conv_cls2.weight": (256, 256, 3, 3),
    "regress_adjust.weight": (20, 20, 1, 1),
}


@pytest.fixture(scope="module")
def model(tmp_path_factory) -> Path:
    """A file with the published names and shapes, in the format of their time, without the batch counters."""
    torch.manual_seed(0)
    state = {name: value for name, value in SiamRpn().state_dict().items() if "num_batches" not in name}
    path = tmp_path_factory.mktemp("models") / "SiamRPNVOT.model"
    torch.save(state, path, _use_new_zipfile_serialization=False)
    return path


def test_the_network_has_the_published_names_shapes_and_parameters():
    state = SiamRpn().state_dict()
    assert {name: tuple(state[name].shape) for name in OFFICIAL_SHAPES} == OFFICIAL_SHAPES
    assert sum(value.numel() for value in SiamRpn().parameters()) == pytest.approx(22.6e6, rel=0.01)
    with torch.device("meta"):
        big = SiamRpn(2, 512)
    assert sum(value.numel() for value in big.parameters()) == pytest.approx(90.4e6, rel=0.01)


def test_an_instance_of_271_pixels_gives_19_by_19_places_with_five_anchors():
    network = SiamRpn().eval()
    with torch.inference_mode():
        kernels = network.remember(as_bgr(np.zeros((127, 127), np.uint8)))
        scores, changes = network.match(kernels, network.window(as_bgr(np.zeros((271, 271), np.uint8))))
    assert scores.shape == (5, 19, 19)
    assert changes.shape == (4, 5, 19, 19)
    boxes = boxes_of(torch.zeros(4, 5, 19, 19), (271, 271))
    assert boxes[0, 0, 0].tolist() == [271 / 2 + step for step in range(-72, 73, 8)]
    assert [tuple(size) for size in boxes[2:, :, 9, 9].T.tolist()] == list(ANCHORS)


def test_a_published_file_loads_and_serves_a_search(model):
    network = load_siamrpn(model)
    assert not network.training
    tracker = make_recovery(RecoveryConfig(tracker="siamrpn", siamrpn_model=str(model), network_agreeing=1))()
    image = np.random.default_rng(1).integers(0, 256, (180, 240)).astype(np.uint8)
    tracker.remember(image, Box(60, 60, 40, 40))
    found = tracker.search(image, Box(60, 60, 40, 40))
    assert found is None or 0 <= found.score <= 1


def test_a_file_of_another_network_is_refused_in_one_line(tmp_path):
    path = tmp_path / "other.model"
    torch.save({"layer.weight": torch.zeros(2, 2)}, path)
    with pytest.raises(RecoveryError, match=r"other\.model: conv_r1\.weight is of none of DaSiamRPN's networks"):
        load_siamrpn(path)
    torch.save([1, 2, 3], path)
    with pytest.raises(RecoveryError, match="no weights by name"):
        load_siamrpn(path)


def test_missing_and_wrong_layers_are_named(model, tmp_path):
    state = torch.load(model, weights_only=True)
    path = tmp_path / "wrong.model"
    torch.save({name: value for name, value in state.items() if name != "conv_r2.bias"}, path)
    with pytest.raises(RecoveryError, match=r"conv_r2\.bias is missing"):
        load_siamrpn(path)
    torch.save({**state, "conv_r2.bias": torch.zeros(3)}, path)
    with pytest.raises(RecoveryError, match=r"conv_r2\.bias is \(3,\), DaSiamRPN's is \(256,\)"):
        load_siamrpn(path)
    torch.save({**state, "conv_r2.bias": torch.full((256,), torch.nan)}, path)
    with pytest.raises(RecoveryError, match="not finite"):
        load_siamrpn(path)


@pytest.mark.parametrize("share", [0.0, 0.0001, 0.5, 0.99])
def test_cut_off_files_are_refused(model, tmp_path, share):
    content = model.read_bytes()
    path = tmp_path / "half.model"
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(RecoveryError, match=r"half\.model"):
        load_siamrpn(path)


def test_a_file_that_is_cut_or_changed_at_any_byte_is_refused(tmp_path):
    path = tmp_path / "small.model"
    torch.save({"conv_r1.weight": torch.zeros(2, 2)}, path, _use_new_zipfile_serialization=False)
    content = path.read_bytes()
    for place, byte in enumerate(content):
        for damaged in (content[:place], content[:place] + bytes([byte ^ 1]) + content[place + 1 :]):
            path.write_bytes(damaged)
            with pytest.raises(RecoveryError, match=r"small\.model: "):
                load_siamrpn(path)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "it is empty"),
        (b"\xef\xbb\xbf\r\n<!DOCTYPE html><html></html>", "it is a web page"),
        (b"no weights\n", "it is not in torch's format"),
        (b"\x80\x41weights", "it is damaged, or holds more than weights"),
        (b"PK\3\4weights", "it is damaged, or holds more than weights"),
    ],
)
def test_what_is_wrong_with_a_file_is_one_line_and_no_advice_to_load_it_unsafely(tmp_path, content, reason):
    path = tmp_path / "SiamRPNVOT.model"
    path.write_bytes(content)
    with pytest.raises(RecoveryError) as refused:
        load_siamrpn(path)
    assert str(refused.value) == (
        f"{path}: not a file of plain weights ({reason}): download DaSiamRPN's SiamRPNVOT.model again, or give another "
        ".model of it"
    )


@pytest.mark.parametrize("content", [b"", b"weights\n", b"\x20" + bytes(7) + b"{"])
def test_a_damaged_safetensors_file_is_refused_in_one_line(tmp_path, content):
    path = tmp_path / "junk.safetensors"
    path.write_bytes(content)
    with pytest.raises(RecoveryError, match=r"junk\.safetensors: not a file of plain weights \(it is no readable safe"):
        load_siamrpn(path)


def test_published_weights_load_from_a_safetensors_file_but_no_others(model, tmp_path):
    path = tmp_path / "SiamRPNVOT.safetensors"
    state = torch.load(model, weights_only=True)
    save_file(state, path)
    loaded = load_siamrpn(path).state_dict()
    assert all(torch.equal(loaded[name], value) for name, value in state.items())
    with pytest.raises(RecoveryError, match="conv_r1.weight is of none of DaSiamRPN's networks"):
        load_siamrpn(SHIPPED)


class _Evil:
    def __init__(self, trace: Path) -> None:
        self._trace = trace

    def __reduce__(self):
        return os.mkdir, (str(self._trace),)


@pytest.mark.parametrize("as_zip", [True, False])
def test_code_in_a_file_is_not_run(tmp_path, as_zip):
    trace, path = tmp_path / "was_run", tmp_path / "evil.model"
    if as_zip:
        torch.save({"conv_r1.weight": _Evil(trace)}, path)
    else:
        path.write_bytes(pickle.dumps({"conv_r1.weight": _Evil(trace)}, protocol=2))
    with pytest.raises(RecoveryError, match=r"evil\.model: not a file of plain weights"):
        load_siamrpn(path)
    assert not trace.exists()


def test_a_torch_that_would_run_code_in_a_file_is_not_used_for_it(model, monkeypatch):
    monkeypatch.setattr(torch, "__version__", TorchVersion("2.5.1+cpu"))
    with pytest.raises(RecoveryError, match=r"2\.5\.1\+cpu may run code that hides in it: pip install 'torch>=2\.6'"):
        load_siamrpn(model)


def test_tensors_without_plain_numbers_are_refused(model, tmp_path):
    state = torch.load(model, weights_only=True)
    path = tmp_path / "odd.model"
    bias = state["conv_r2.bias"]
    for odd in (bias.to_sparse(), bias.to("meta"), bias > 0, bias.to(torch.float8_e4m3fn)):
        torch.save({**state, "conv_r2.bias": odd}, path)
        with pytest.raises(RecoveryError, match="no weights by name"):
            load_siamrpn(path)


def test_a_file_that_is_not_named_or_not_there_is_asked_for(tmp_path):
    with pytest.raises(RecoveryError, match="set the parameter recovery.siamrpn_model"):
        make_recovery(RecoveryConfig(tracker="siamrpn"))
    with pytest.raises(RecoveryError, match=r"missing\.model: no readable file"):
        make_recovery(RecoveryConfig(tracker="siamrpn", siamrpn_model=str(tmp_path / "missing.model")))
