"""Build description of the ament_python package; `colcon build` and pip both read it."""

from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "etd_ros"
NODES = ("accumulator", "pipeline", "reconstruction", "replay", "tracker")
BENCHMARK_PEERS = ["dv-processing>=2.0", "evt3>=0.4", "expelliarmus>=1.1", "frames2py>=1.1", "tonic>=1.6"]
TEST_REQUIREMENTS = ["hypothesis", "pytest", "selenium"]


def shared(*folders: str) -> list[tuple[str, list[str]]]:
    """data_files entries that put each folder's files in share/etd_ros."""
    return [
        (f"share/{PACKAGE}/{folder}", sorted(str(path) for path in Path(folder).glob("*") if path.is_file()))
        for folder in folders
    ]


setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(include=["etd_ros", "etd_ros.*", "msg_adapters", "msg_adapters.*"]),
    package_data={
        "etd_ros": ["py.typed", "labelling/page/*", "recovery/weights/*.safetensors", "tracking/weights/*.npz"],
        "msg_adapters": ["py.typed"],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        *shared("config", "foxglove", "launch", "rviz", "security"),
    ],
    python_requires=">=3.10",
    install_requires=[
        "setuptools",
        "numpy>=1.26",
        "numba>=0.56",
        "llvmlite",
        "scipy>=1.11",
        "PyYAML>=6.0",
        "rich>=13.7",
        "rosbags>=0.10",
    ],
    extras_require={
        "aedat": ["aedat>=2.3"],
        "bench": BENCHMARK_PEERS,
        "cluster": ["distributed>=2024.1"],
        "plot": ["matplotlib>=3.6"],
        "recovery": ["torch>=2.6", "safetensors>=0.4"],
        "simulate": ["scikit-image>=0.22"],
        "test": TEST_REQUIREMENTS,
        "viz": ["rerun-sdk>=0.23"],
    },
    tests_require=TEST_REQUIREMENTS,
    zip_safe=False,
    author="etd_ros maintainers",
    maintainer="etd_ros maintainers",
    maintainer_email="maintainers@users.noreply.example.org",
    description="Tracks objects in event-camera data and publishes their bounding boxes.",
    license="Apache-2.0",
    entry_points={"console_scripts": [f"{node} = {PACKAGE}.nodes.programs:{node}" for node in NODES]},
)
