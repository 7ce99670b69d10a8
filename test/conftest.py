"""What the tests work on, and where."""

import os
import signal
from pathlib import Path

import pytest
from hypothesis import settings

REPOSITORY = Path(__file__).resolve().parents[1]

# How long an example takes depends on the machine: no test is to fail by that.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")

# A shell that starts the tests in the background has them ignore Ctrl-C, and with them all that they interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of labelled real recordings."""
    folder = Path(os.environ.get("ETD_DATA", REPOSITORY.parent / "shared" / "data"))
    assert folder.is_dir(), f"{folder} is missing: set ETD_DATA to the folder of real recordings"
    return folder


@pytest.fixture(scope="session")
def repository() -> Path:
    """The checkout."""
    return REPOSITORY


@pytest.fixture
def demo(repository: Path) -> Path:
    """The bundled recording."""
    return repository / "bags" / "demo"


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder, so that whatever a command leaves is seen."""
    folder = tmp_path / "place"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder
