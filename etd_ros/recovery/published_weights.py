"""Files of weights that others have published: read as plain numbers, checked, and one line where they do not fit."""

from __future__ import annotations

import os
import pickle
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor, nn

from etd_ros.recovery.interface import RecoveryError
from etd_ros.recovery.weights_file import load_plain

FILE_BYTES_MAX = 1 << 30
NUMBERS = (torch.float16, torch.bfloat16, torch.float32, torch.float64, torch.int64)
"""Types of weights, and of the counter of batches; not those of 8 bits, of which torch cannot tell what is finite."""


class Origin(NamedTuple):
    """Whose files they are.

    Attributes:
        network: what it is called.
        parameter: which names its file.
        file: the best known one.
        others: what else may be given.
    """

    network: str
    parameter: str
    file: str
    others: str


def published_state(path: Path, origin: Origin) -> dict[str, Tensor]:
    """Tensors by name, of a file in torch's or, if it is named so, in safetensors' format; no code in it is run.

    Raises:
        RecoveryError: no readable file, not a file of weights, or this torch is no protection from code in it.
    """
    if not path.is_file() or not os.access(path, os.R_OK):
        named = f"recovery.{origin.parameter}"
        msg = f"{path}: no readable file; set the parameter {named} to {origin.file}, or {origin.others}"
        raise RecoveryError(msg)
    if path.stat().st_size > FILE_BYTES_MAX:
        msg = f"{path}: {path.stat().st_size >> 20} MiB are too many for {origin.network}: give {origin.file}"
        raise RecoveryError(msg)
    try:
        loaded = load_plain(path)
    except pickle.UnpicklingError as err:
        msg = (
            f"{path}: not a file of plain weights ({err}): download {origin.network}'s {origin.file} again, or give "
            f"{origin.others}"
        )
        raise RecoveryError(msg) from err
    weights = loaded if isinstance(loaded, dict) else {}
    if not weights or not all(isinstance(name, str) and _is_plain(value) for name, value in weights.items()):
        msg = f"{path}: no weights by name; give {origin.network}'s {origin.file}, or {origin.others}"
        raise RecoveryError(msg)
    return weights


def load_published(network: nn.Module, state: dict[str, Tensor], path: Path, origin: Origin) -> None:
    """Give a network the weights of a file.

    Raises:
        RecoveryError: they are of another network, or not finite.
    """
    expected = network.state_dict()
    # Files older than the counter of batches lack it; inference does not use it.
    needed = {name for name in expected if not name.endswith("num_batches_tracked")}
    for name in sorted(needed | set(state)):
        there, wanted = (tuple(values[name].shape) if name in values else None for values in (state, expected))
        if there != wanted:
            msg = (
                f"{path}: {name} is {there or 'missing'}, {origin.network}'s is {wanted or 'not there'}: give "
                f"{origin.file}, or {origin.others}"
            )
            raise RecoveryError(msg)
    if not all(bool(torch.isfinite(tensor).all()) for tensor in state.values()):
        msg = f"{path}: holds numbers that are not finite: the file is damaged, get it again"
        raise RecoveryError(msg)
    network.load_state_dict(state, strict=False)


def _is_plain(value: object) -> bool:
    """Whether something is a tensor whose numbers are all there, neither sparse, nor quantised, nor without memory."""
    if not isinstance(value, Tensor) or value.layout is not torch.strided or value.is_quantized:
        return False
    return value.device.type == "cpu" and value.dtype in NUMBERS
