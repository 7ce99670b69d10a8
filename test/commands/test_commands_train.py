"""`train` leaves weights behind, goes on where it stopped, and says in one line what is wrong."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from etd_ros.cli import main
from etd_ros.recovery import RecoveryConfig, make_recovery, making
from etd_ros.recovery.picture_trackers import make_siamfc
from etd_ros.recovery.training.box_samples import SampleCache
from etd_ros.recovery.training.config import VALIDATION_SEEDS
from etd_ros.tracking.box_network import load_box_network

TINY = (
    *("--steps", "2", "--batch", "2", "--sequences", "1", "--first-sequences", "1"),
    *("--validation-sequences", "1", "--validation-batches", "1", "--interval", "1"),
)


def test_it_trains_goes_on_and_its_weights_serve_a_tracker(place):
    assert main(["train", "--output", "out", "--cache", "cache", *TINY]) == 0
    assert sorted(path.name for path in (place / "out").iterdir()) == [
        "checkpoint.pt",
        "compact.safetensors",
        "log.csv",
    ]
    longer = [*TINY[:1], "3", *TINY[2:]]
    assert main(["train", "--output", "out", "--cache", "cache", "--resume", *longer]) == 0
    steps = [line.partition(",")[0] for line in (place / "out" / "log.csv").read_text().splitlines()]
    assert steps == ["step", "1", "2", "3"]
    make_recovery(RecoveryConfig(tracker="compact", compact_model=str(place / "out" / "compact.safetensors")))()


def test_a_training_that_is_there_is_not_overwritten(place, capsys):
    begin = ["train", "--output", "out", "--cache", "cache", *TINY]
    assert main(begin) == 0
    before = {path: path.read_bytes() for path in (place / "out").iterdir()}
    for options in ([], ["--seed", "3"], ["--network", "siamfc"], ["--weights", "out/compact.safetensors"]):
        capsys.readouterr()
        assert main([*begin, *options]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert "out: holds a training (checkpoint.pt, log.csv" in line
        assert "go on with --resume, or name another folder" in line
    assert {path: path.read_bytes() for path in (place / "out").iterdir()} == before
    (place / "out" / "checkpoint.pt").unlink()
    assert main(begin) == 2
    assert "out: holds a training (log.csv, compact.safetensors)" in capsys.readouterr().err


def test_weights_are_trained_further_on_request(place):
    first = ["train", "--output", "first", "--cache", "cache", *TINY]
    assert main(first) == 0
    begun = ["--weights", "first/compact.safetensors", "--learning-rate", "1e-7", "--seed", "1"]
    assert main(["train", "--output", "more", "--cache", "cache", *TINY, *begun]) == 0
    before, after = (load_file(place / name / "compact.safetensors") for name in ("first", "more"))
    torch.testing.assert_close(after["backbone.0.weight"], before["backbone.0.weight"], atol=1e-5, rtol=0)


def test_siamfc_is_trained_on_request(place):
    assert main(["train", "--network", "siamfc", "--output", "out", "--cache", "cache", *TINY]) == 0
    weights = place / "out" / "siamfc.safetensors"
    make_siamfc(RecoveryConfig(siamfc_model=str(weights)))()
    assert sorted(path.name for path in (place / "cache").iterdir())[0] == "0000000.frame_boxes.npy"


def test_the_network_that_puts_boxes_right_is_trained_on_request(place, capsys):
    cache = SampleCache(place / "cache")
    cache.make(0)
    # Validation's own scene takes long to simulate.
    shutil.copy(place / "cache" / "0000000.box.npz", place / "cache" / f"{VALIDATION_SEEDS:07}.box.npz")
    command = ["train", "--network", "box", "--output", "out", "--cache", "cache"]
    assert main([*command, *TINY]) == 0
    assert "mean IoU 0." in capsys.readouterr().err
    weights = place / "out" / "box.npz"
    view, _ = cache.samples(0).view(0)
    misfit = load_box_network(weights).misfit_of(view)
    assert np.isfinite(misfit.offsets).all()
    assert (misfit.spreads > 0).all()
    assert sorted(path.name for path in (place / "out").iterdir()) == ["box.npz", "checkpoint.pt", "log.csv"]
    header, *rows = (place / "out" / "log.csv").read_text().splitlines()
    assert header == "step,seconds,learning_rate,likelihood,validation_loss,validation_before,validation_after"
    assert [row.partition(",")[0] for row in rows] == ["1", "2"]
    more = ["--output", "more", "--weights", str(weights), "--learning-rate", "1e-7"]
    assert main([*command, *TINY, *more]) == 0
    trained_further = load_box_network(place / "more" / "box.npz").misfit_of(view)
    assert trained_further.offsets == pytest.approx(misfit.offsets, abs=1e-3)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--resume"], "no checkpoint to go on from"),
        (["--steps", "0"], "steps = 0 is out of range"),
        (["--minutes", "-1"], "more than 0 minutes"),
        (["--threads", "0"], "give 1 to"),
        (["--processes", "0"], "give 1 to"),
        (["--weights", "nowhere"], "no readable safetensors file"),
        (["--network", "box", "--weights", "nowhere"], "no weights of the box network"),
        (["--settled", "1"], "give --weights, or less"),
    ],
)
def test_bad_input_is_one_line(place, capsys, arguments, said):
    assert main(["train", "--output", "out", "--cache", "cache", *arguments]) == 2
    error = capsys.readouterr().err.splitlines()
    assert len(error) == 1
    assert said in error[0]


@pytest.mark.parametrize("network", ["compact", "siamfc", "box"])
def test_weights_that_are_refused_leave_no_folders_behind(place, capsys, network):
    (place / "junk.safetensors").write_text("junk\n")
    command = ["train", "--network", network, "--output", "out", "--cache", "cache"]
    for options in (["--weights", "junk.safetensors"], ["--resume"]):
        assert main([*command, *options]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert "trust" not in line
    assert [path.name for path in place.iterdir()] == ["junk.safetensors"]


def test_a_cache_that_cannot_be_made_is_told_before_the_work(place, capsys):
    (place / "notes.txt").write_text("")
    assert main(["train", "--output", "out", "--cache", "notes.txt", *TINY]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "notes.txt is no folder" in line


def test_without_torch_it_says_how_to_get_it(place, capsys, monkeypatch):
    monkeypatch.setattr(making, "find_spec", lambda _: None)
    assert main(["train", "--output", "out", "--cache", "cache"]) == 2
    assert "pip install torch safetensors" in capsys.readouterr().err
    assert not list(place.iterdir())
