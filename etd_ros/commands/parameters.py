"""`parameters`: every parameter of the method with default, range and meaning, as a table or as YAML for the nodes."""

from __future__ import annotations

import argparse
from typing import Any

import yaml

from etd_ros.parameters import Description
from etd_ros.settings import STAGES, described_settings


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("parameters", help="print every parameter with its default", description=__doc__)
    parser.add_argument("--yaml", action="store_true", help="as a ROS 2 parameter file (config/etd_ros.yaml)")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Print."""
    print(parameter_yaml() if options.yaml else parameter_table(), end="")
    return 0


def parameter_table() -> str:
    """A Markdown table of all parameters."""
    lines = ["| parameter | default | range | meaning |", "|-|-|-|-|"]
    for name, default, description in described_settings():
        lines.append(f"| `{name}` | {_default(default)} | {_range(description)} | {description.text} |")
    return "\n".join(lines) + "\n"


def parameter_yaml() -> str:
    """A parameter file that sets every parameter to its default, each explained."""
    lines = ["# Every parameter of the method with its default. Made by: python -m etd_ros parameters --yaml"]
    lines += ["/**:", "  ros__parameters:"]
    for stage in STAGES:
        lines.append(f"    {stage}:")
        for name, default, description in described_settings((stage,)):
            allowed = _range(description)
            lines.append(f"      # {description.text}{f' {allowed}' if allowed else ''}")
            lines.append(f"      {name.partition('.')[2]}: {_yaml_value(default)}")
    return "\n".join(lines) + "\n"


def _yaml_value(value: Any) -> str:
    plain = list(value) if isinstance(value, tuple) else value
    return str(yaml.safe_dump(plain, default_flow_style=True)).removesuffix("\n...\n").strip()


def _default(value: Any) -> str:
    return f"`{_yaml_value(value)}`" if value != "" else ""


def _range(description: Description) -> str:
    if description.choices:
        return ", ".join(description.choices)
    if description.low is None and description.high is None:
        return ""
    low = "" if description.low is None else f"{description.low:g}"
    high = "" if description.high is None else f"{description.high:g}"
    return f"[{low}, {high}]"
