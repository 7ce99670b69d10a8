"""All parameters of the method in one place, under the names that the nodes, YAML files and `--set` share."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from etd_ros.conversion import AtsltdConfig, FixedCountConfig, FixedWindowConfig, NoiseFilterConfig
from etd_ros.detection import EdgeBoxesConfig
from etd_ros.parameters import Description, ParameterError, Parameters, described, from_mapping, meant, nearest
from etd_ros.reconstruction import HighPassConfig
from etd_ros.recovery import RecoveryConfig
from etd_ros.stream import StreamConfig
from etd_ros.tracking import ContourConfig, DiscoveryConfig, TrackerConfig


@dataclass(frozen=True, slots=True)
class Settings:
    """One configuration for each stage. A parameter's full name is `<stage>.<name>`, as in `atsltd.nzge_interval`."""

    stream: StreamConfig = field(default_factory=StreamConfig)
    noise_filter: NoiseFilterConfig = field(default_factory=NoiseFilterConfig)
    atsltd: AtsltdConfig = field(default_factory=AtsltdConfig)
    fixed_window: FixedWindowConfig = field(default_factory=FixedWindowConfig)
    fixed_count: FixedCountConfig = field(default_factory=FixedCountConfig)
    detection: EdgeBoxesConfig = field(default_factory=EdgeBoxesConfig)
    tracking: TrackerConfig = field(default_factory=TrackerConfig)
    contours: ContourConfig = field(default_factory=ContourConfig)
    discovery: DiscoveryConfig = field(default_factory=DiscoveryConfig)
    reconstruction: HighPassConfig = field(default_factory=HighPassConfig)
    recovery: RecoveryConfig = field(default_factory=RecoveryConfig)


STAGES: dict[str, type[Parameters]] = {
    stage.name: stage.default_factory  # type: ignore[misc]
    for stage in dataclasses.fields(Settings)
}
"""Configuration class of each stage, in the order of the flow."""

STAGE_LIKENESS_MIN = 0.8
"""How much a name in a file is like a stage's, as difflib has it, to be taken for that, misspelt."""


def described_settings(stages: tuple[str, ...] = tuple(STAGES)) -> Iterator[tuple[str, Any, Description]]:
    """(full name, default, description) of every parameter of the stages."""
    for stage in stages:
        for name, default, description in described(STAGES[stage]):
            yield f"{stage}.{name}", default, description


def settings_from_mapping(values: Mapping[str, Any]) -> Settings:
    """Settings from full names and values; what is not named keeps its default.

    Raises:
        ParameterError: an unknown name, a value of another type, or one out of range.
    """
    by_stage: dict[str, dict[str, Any]] = {}
    for full_name, value in values.items():
        stage, _, name = full_name.partition(".")
        if stage not in STAGES:
            known = [known for known, _, _ in described_settings()]
            msg = f"unknown parameter {full_name!r}{meant(full_name, known)}: `python -m etd_ros parameters` lists them"
            raise ParameterError(msg)
        by_stage.setdefault(stage, {})[name] = value
    configs: dict[str, Any] = {}
    for stage, stage_values in by_stage.items():
        try:
            configs[stage] = from_mapping(STAGES[stage], stage_values)
        except ParameterError as err:
            msg = f"{stage}: {err}"
            raise ParameterError(msg) from err
    return Settings(**configs)


def read_parameter_file(path: Path) -> dict[str, Any]:
    """Full names and values from a ROS 2 parameter file; the stages are taken from every node in it.

    Raises:
        ParameterError: the file is missing, is not YAML, holds no `ros__parameters` or none of the stages, or a name
            that is nearly one of theirs.
    """
    try:
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
        nodes = list(_node_parameters(document))
    except (OSError, UnicodeDecodeError) as err:
        msg = f"{path}: cannot be read ({err}): name a ROS 2 parameter file"
        raise ParameterError(msg) from err
    # Beside its own errors PyYAML lets those of impossible dates and numbers pass, and of endless nesting.
    except (yaml.YAMLError, ValueError, RecursionError) as err:
        msg = f"{path}: is not YAML ({' '.join(str(err).split())}): name a ROS 2 parameter file"
        raise ParameterError(msg) from err
    if not nodes:
        msg = f"{path}: holds no ros__parameters mapping: write one as in config/etd_ros.yaml"
        raise ParameterError(msg)
    flat = dict(item for node in nodes for item in _flatten(node, ""))
    of_stages = {name: value for name, value in flat.items() if name.partition(".")[0] in STAGES and "." in name}
    _refuse_misspelt(path, flat.keys() - of_stages.keys())
    if not of_stages:
        msg = f"{path}: holds no parameter of the method: `python -m etd_ros parameters` lists them"
        raise ParameterError(msg)
    return of_stages


def _refuse_misspelt(path: Path, others: Iterable[str]) -> None:
    """Of what is of no stage only what has nearly the name of one is wrong: files for several nodes hold what is of the
    nodes alone, and of other packages."""
    for name in sorted(others):
        stage, dot, rest = name.partition(".")
        near = nearest(stage, STAGES, STAGE_LIKENESS_MIN) if dot else None
        if near:
            msg = (
                f"{path}: unknown parameter {name!r} (is {near}.{rest} meant?): `python -m etd_ros parameters` "
                "lists them"
            )
            raise ParameterError(msg)


def _node_parameters(document: Any) -> Iterator[Mapping[str, Any]]:
    if isinstance(document, Mapping):
        for name, value in document.items():
            if name == "ros__parameters" and isinstance(value, Mapping):
                yield value
            else:
                yield from _node_parameters(value)


def _flatten(values: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _flatten(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value
