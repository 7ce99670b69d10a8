"""Where compiled kernels go on a read-only installation."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import pytest

from etd_ros import kernel_cache
from etd_ros.kernel_cache import CACHE_VARIABLE, choose_kernel_cache

UNWRITABLE = Path("/proc/nowhere")


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    """An empty folder for temporary files, an installation and a home that nobody can write to."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(kernel_cache, "PACKAGE", UNWRITABLE)
    monkeypatch.setenv("XDG_CACHE_HOME", str(UNWRITABLE))
    # Set before it is taken away, so that what the code under test sets is undone afterwards.
    monkeypatch.setenv(CACHE_VARIABLE, "")
    monkeypatch.delenv(CACHE_VARIABLE)
    return tmp_path


def test_the_compiler_chooses_where_it_can_write(temporary, monkeypatch, tmp_path):
    monkeypatch.setattr(kernel_cache, "PACKAGE", tmp_path / "package")
    choose_kernel_cache()
    assert CACHE_VARIABLE not in os.environ
    monkeypatch.setattr(kernel_cache, "PACKAGE", UNWRITABLE)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    choose_kernel_cache()
    assert CACHE_VARIABLE not in os.environ


def test_a_folder_that_the_user_has_named_stays(temporary, monkeypatch):
    monkeypatch.setenv(CACHE_VARIABLE, "/somewhere")
    choose_kernel_cache()
    assert os.environ[CACHE_VARIABLE] == "/somewhere"


def test_otherwise_a_temporary_folder_is_used_again_and_again(temporary, monkeypatch):
    chosen = []
    for _ in range(2):
        choose_kernel_cache()
        chosen.append(Path(os.environ[CACHE_VARIABLE]))
        monkeypatch.delenv(CACHE_VARIABLE)
    assert chosen[0] == chosen[1]
    assert chosen[0].parent == temporary
    assert chosen[0].stat().st_mode & 0o077 == 0


def test_a_user_without_home_gets_one_too(temporary, monkeypatch):
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)
    choose_kernel_cache()
    assert Path(os.environ[CACHE_VARIABLE]).parent == temporary


def test_a_folder_that_others_can_write_to_is_not_trusted(temporary):
    planted = temporary / f"etd_ros_kernels_{os.getuid()}"
    planted.mkdir()
    planted.chmod(0o777)
    choose_kernel_cache()
    chosen = Path(os.environ[CACHE_VARIABLE])
    assert chosen != planted
    assert chosen.is_dir()


def test_neither_is_a_link_to_elsewhere(temporary):
    planted = temporary / f"etd_ros_kernels_{os.getuid()}"
    planted.symlink_to(temporary / "elsewhere")
    choose_kernel_cache()
    assert Path(os.environ[CACHE_VARIABLE]) != planted
