"""Weights of the compact network in safetensors files: plain numbers, so that no code can hide in them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save

from etd_ros.recovery.compact import Compact
from etd_ros.recovery.interface import RecoveryError

SHIPPED = Path(__file__).parent / "weights" / "compact.safetensors"
NETWORK = "etd_ros compact 1"
"""In a file's metadata: another layout of layers gets another number."""


def save_compact(network: Compact, path: Path, about: Mapping[str, str]) -> None:
    """Write the weights; `about` goes into the file's metadata."""
    state = {name: tensor.detach().cpu().contiguous() for name, tensor in network.state_dict().items()}
    path.write_bytes(save(state, {"network": NETWORK, **about}))


def load_compact(path: Path = SHIPPED) -> Compact:
    """The network with the weights of a file, for inference.

    Raises:
        RecoveryError: no readable safetensors file, or not of this network.
    """
    network = Compact()
    expected = network.state_dict()
    try:
        with safe_open(path, framework="pt") as file:
            if (file.metadata() or {}).get("network") != NETWORK or set(file.keys()) != set(expected):
                msg = f"{path}: weights of another network than {NETWORK!r}; train it anew with this version"
                raise RecoveryError(msg)
            # Shapes are read from the header, before anything is allocated for them.
            for name, tensor in expected.items():
                shape = file.get_slice(name).get_shape()
                if list(shape) != list(tensor.shape):
                    msg = f"{path}: {name} has the shape {shape}, not {list(tensor.shape)}: train the network anew"
                    raise RecoveryError(msg)
            state = {name: file.get_tensor(name) for name in expected}
    except (OSError, SafetensorError) as err:
        msg = f"{path}: no readable safetensors file ({' '.join(str(err).split())[:80]}); name one made by `train`"
        raise RecoveryError(msg) from err
    if not all(bool(torch.isfinite(tensor).all()) for tensor in state.values()):
        msg = f"{path}: holds numbers that are not finite: the training went wrong, or the file is damaged"
        raise RecoveryError(msg)
    network.load_state_dict(state)
    return network.eval()
