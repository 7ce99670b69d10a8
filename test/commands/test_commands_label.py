"""`label`: what it refuses, and how it ends."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import urllib.request
from contextlib import ExitStack
from pathlib import Path

import command_bags
import pytest

from etd_ros.cli import main


@pytest.fixture
def bag(tmp_path):
    return command_bags.sound(tmp_path / "bag")


@pytest.fixture
def label(repository, bag):
    """Starts the command at 100 pictures a second; what still runs after the test is ended."""
    with ExitStack() as running:

        def started(output):
            options = ["--output", str(output), "--no-browser", "--rate", "100"]
            pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
            process = running.enter_context(
                subprocess.Popen(
                    [sys.executable, "-m", "etd_ros", "label", str(bag), *options],
                    cwd=repository,
                    start_new_session=True,
                    **pipes,
                )
            )
            running.callback(process.kill)
            return process

        yield started


def post(url, name, content):
    request = urllib.request.Request(url + name, content.encode(), {"Content-Type": "application/json"})
    with urllib.request.urlopen(request, timeout=30) as answer:
        assert answer.status == 200


BOX = '{"action": "box", "target": "ball", "picture": 0, "box": [1, 2, 3, 4]}'


@pytest.mark.parametrize("is_saved", [True, False])
def test_ctrl_c_ends_it_and_says_where_the_labels_are(label, tmp_path, is_saved):
    output = tmp_path / "boxes.csv"
    process = label(output)
    first = process.stdout.readline()
    assert re.match(r"\d reconstruction pictures of bag: http://127.0.0.1:\d+/\S+/ \(Ctrl-C ends\)", first)
    url = re.search(r"http://\S+", first)[0]
    post(url, "edit", BOX)
    if is_saved:
        post(url, "save", "{}")
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (0, "")
    assert (f"saved: {output}\n" in out) == is_saved
    assert ("not saved, but kept in" in out) != is_saved
    assert output.exists() == is_saved
    assert output.with_suffix(".keys.json").exists()


def test_what_is_ended_without_a_label_leaves_nothing(label, tmp_path, bag):
    process = label(tmp_path / "boxes.csv")
    process.stdout.readline()
    process.send_signal(signal.SIGINT)
    assert process.communicate(timeout=60)[0].split("\n")[-2] == "nothing labelled"
    assert list(tmp_path.iterdir()) == [bag]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--on", "video"], "no video picture to label: try --on reconstruction"),
        (["--rate", "-1"], "--rate -1 is out of range"),
        (["--port", "99999", "--rate", "100"], "port 99999 cannot be used"),
    ],
)
def test_what_cannot_be_labelled_is_refused_in_one_line(capsys, place, bag, options, message):
    assert main(["label", str(bag), "--output", "boxes.csv", "--no-browser", *options]) == 2
    captured = capsys.readouterr()
    assert message in captured.err
    assert captured.err.count("\n") == 1
    assert list(place.iterdir()) == []


def test_an_output_in_a_folder_that_does_not_exist_is_refused_before_the_work(capsys, place, bag):
    assert main(["label", str(bag), "--output", "missing/boxes.csv", "--no-browser"]) == 2
    assert "missing/boxes.csv: cannot be written" in capsys.readouterr().err


def test_a_csv_that_is_none_is_refused(capsys, place, bag):
    (place / "boxes.csv").write_text("nonsense")
    assert main(["label", str(bag), "--output", "boxes.csv", "--no-browser", "--rate", "100"]) == 2
    assert "boxes.csv, line 1" in capsys.readouterr().err


def test_the_browser_is_led_to_the_page_by_a_file_that_only_the_user_can_read(capsys, place, bag, monkeypatch):
    seen = {}

    def opened(url):
        path = Path(url.removeprefix("file://"))
        seen["page"] = path.read_text()
        seen["mode"] = path.stat().st_mode & 0o777
        raise KeyboardInterrupt

    monkeypatch.setattr("webbrowser.open", opened)
    assert main(["label", str(bag), "--output", "boxes.csv", "--rate", "100"]) == 0
    address = re.search(r"http://\S+", capsys.readouterr().out)[0]
    assert f"url={address}" in seen["page"]
    assert seen["mode"] == 0o600
