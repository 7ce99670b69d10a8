"""package.xml, setup.py and the change log agree with each other and with the code."""

import ast
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

ROSDEP_KEYS = {
    "cv2": "python3-opencv",
    "llvmlite": "python3-numba",  # a part of it, which has no key of its own
    "rosbags": "python3-rosbags-pip",
    "yaml": "python3-yaml",
}
PYTHON_MODULES = {"matplotlib", "numba", "numpy", "rich", "scipy"}
OPTIONAL = {"aedat": "aedat", "distributed": "cluster", "rerun": "viz", "safetensors": "recovery", "torch": "recovery"}
"""Imported only by what needs them: extras of setup.py name them, package.xml does not."""
DISTRIBUTIONS = {"rerun": "rerun-sdk"}
OWN = {"etd_ros", "msg_adapters"}


def rosdep_key(module: str) -> str:
    return f"python3-{module}" if module in PYTHON_MODULES else ROSDEP_KEYS.get(module, module)


def imported_modules(folders: list[Path]) -> set[str]:
    modules = set()
    for path in (path for folder in folders for path in folder.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                modules |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                modules.add(node.module.split(".")[0])
    return modules - set(sys.stdlib_module_names) - OWN - set(OPTIONAL)


def test_package_xml_names_everything_that_the_code_imports(repository: Path) -> None:
    root = ElementTree.parse(repository / "package.xml").getroot()
    declared = {element.text for tag in ("depend", "exec_depend") for element in root.findall(tag)}
    imported = imported_modules([repository / name for name in ("etd_ros", "msg_adapters", "launch")])
    assert {rosdep_key(module) for module in imported} <= declared


def test_setup_py_has_an_extra_for_everything_that_is_optional(repository: Path) -> None:
    tree = ast.parse((repository / "setup.py").read_text())
    (extras,) = (
        node.value for node in ast.walk(tree) if isinstance(node, ast.keyword) and node.arg == "extras_require"
    )
    assert isinstance(extras, ast.Dict)
    named = {ast.literal_eval(key): ast.unparse(value) for key, value in zip(extras.keys, extras.values, strict=True)}
    # The photographs of scikit-image's wheel are read as files, without an import.
    for package, extra in {**OPTIONAL, "scikit-image": "simulate"}.items():
        assert f"'{DISTRIBUTIONS.get(package, package)}>=" in named[extra], package


def test_one_version_everywhere(repository: Path) -> None:
    command = [sys.executable, "setup.py", "--version"]
    built = subprocess.run(command, cwd=repository, check=True, capture_output=True, text=True).stdout.split()[-1]
    assert ElementTree.parse(repository / "package.xml").getroot().findtext("version") == built
    assert (
        f"Forthcoming\n{'-' * 11}" in (repository / "CHANGELOG.rst").read_text()
        or built in (repository / "CHANGELOG.rst").read_text()
    )


def test_the_requirements_admit_the_versions_of_ubuntu_24_04(repository: Path) -> None:
    platform = {"numpy": (1, 26), "opencv-contrib-python-headless": (4, 6), "scipy": (1, 11), "PyYAML": (6, 0)}
    text = (repository / "scripts" / "requirements-runtime.txt").read_text()
    bounds = {
        name: tuple(map(int, bound.split("."))) for name, bound in re.findall(r"^([\w-]+)>=([\d.]+)$", text, re.M)
    }
    for name, version in platform.items():
        assert bounds[name] <= version, name
