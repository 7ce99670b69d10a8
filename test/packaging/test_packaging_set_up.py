"""The set-up does what is needed and nothing more."""

import importlib.util
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture(scope="module")
def set_up(repository: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location("set_up", repository / "scripts" / "set_up.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["set_up"] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def environment(set_up: ModuleType, tmp_path: Path):
    made = set_up.Environment(tmp_path / "venv", sourced_ros=False)
    made.stamps.mkdir(parents=True)
    return made


def test_a_step_is_done_once_until_what_it_depends_on_changes(set_up: ModuleType, environment) -> None:
    done: list[str] = []
    for current in ("a", "a", "b", "b", "a"):
        set_up.once(environment, "step", current, lambda current=current: done.append(current))
    assert done == ["a", "b", "a"]


def test_a_step_that_failed_is_tried_again(set_up: ModuleType, environment) -> None:
    def fail() -> None:
        msg = "no network"
        raise set_up.SetUpError(msg)

    done: list[str] = []
    set_up.once(environment, "step", "old", lambda: None)
    with pytest.raises(set_up.SetUpError, match="no network"):
        set_up.once(environment, "step", "new", fail)
    for current in ("old", "new"):
        set_up.once(environment, "step", current, lambda current=current: done.append(current))
    assert done == ["old", "new"]


def test_the_digest_changes_with_content_and_facts(set_up: ModuleType, repository: Path) -> None:
    setup, config = repository / "setup.py", repository / "setup.cfg"
    digests = [set_up.digest([setup], "3.11"), set_up.digest([config], "3.11"), set_up.digest([setup], "3.12")]
    assert len(set(digests)) == 3
    assert set_up.digest([setup, config]) == set_up.digest([config, setup])


def test_a_missing_compiler_is_named(set_up: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CXX", raising=False)
    with pytest.raises(set_up.SetUpError, match=r"compiler.*apt install g\+\+"):
        set_up.check_machine()


def test_an_environment_made_with_a_sourced_ros_is_not_used_without_one(set_up: ModuleType, environment) -> None:
    (environment.venv / "pyvenv.cfg").write_text("include-system-site-packages = true\n")
    with pytest.raises(set_up.SetUpError, match="made with a sourced ROS 2.*make clean"):
        set_up.make_venv(environment)


def test_a_failing_command_shows_the_end_of_its_output(set_up: ModuleType) -> None:
    command = [sys.executable, "-c", "print('reason'); raise SystemExit(3)"]
    with pytest.raises(set_up.SetUpError, match=r"reason\s+what to do"):
        set_up.run(command, {}, "what to do")


def test_a_second_set_up_has_nothing_to_do(repository: Path) -> None:
    command = [sys.executable, str(repository / "scripts" / "set_up.py")]
    subprocess.run(command, check=True, capture_output=True)
    assert subprocess.run(command, check=True, capture_output=True, text=True).stdout == ""
