"""Files of weights, read as plain numbers: no code that hides in them is run."""

from __future__ import annotations

import json
import pickle
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import load_file, save
from torch import nn

from etd_ros.recovery.compact import Compact
from etd_ros.recovery.interface import RecoveryError

WEIGHTS = Path(__file__).parent / "weights"
SHIPPED = WEIGHTS / "compact.safetensors"
COMPACT = "etd_ros compact 2"
"""In a file's metadata: another layout of layers gets another number."""

HEADER_START = ALIGNMENT = 8
"""Of a safetensors file (bytes): its header's length, then the header, filled up with spaces, then the numbers."""

ARCHIVE_MAGIC, PICKLE_MAGIC = b"PK", b"\x80"
"""How files in torch's own format begin: an archive, or a pickle, as before torch 1.6."""
BLANKS = b"\xef\xbb\xbf \t\r\n"
"""What may stand before the first tag of a web page: the mark of UTF-8, spaces."""

PICKLES_SAFE_FROM = "2.6"
"""Of torch: before, a file could run code in spite of `weights_only` (CVE-2025-32434)."""


def load_plain(path: Path) -> Any:
    """What a file holds: in safetensors' format where its name says so, else in torch's own.

    Raises:
        pickle.UnpicklingError, RecoveryError: as `load_pickle`.
    """
    if path.suffix != SHIPPED.suffix:
        return load_pickle(path)
    try:
        return load_file(path)
    # As well as its own error, what it makes of types of numbers that this torch does not know.
    except Exception as err:
        msg = "it is no readable safetensors file"
        raise pickle.UnpicklingError(msg) from err


def load_pickle(path: Path, device: torch.device | str = "cpu") -> Any:
    """What a file in torch's own format holds, tensors on `device`.

    Raises:
        pickle.UnpicklingError: it cannot be read, or holds more than plain weights; says why in a few words.
        RecoveryError: this torch is no protection from code in it.
    """
    if torch.__version__ < PICKLES_SAFE_FROM:
        msg = (
            f"{path}: torch {torch.__version__} may run code that hides in it: pip install 'torch>={PICKLES_SAFE_FROM}'"
        )
        raise RecoveryError(msg)
    try:
        # Opened here: torch 2.13 goes by the name, and reads what is called .safetensors in another way.
        with path.open("rb") as file, warnings.catch_warnings():
            # It warns of odd pickles; what is wrong with a file is one line, of who asked for it.
            warnings.simplefilter("ignore", UserWarning)
            return torch.load(file, map_location=device, weights_only=True)
    # Whatever a damaged file makes of the reader. Torch's own words would tell how to load it with what hides in it.
    except Exception as err:
        raise pickle.UnpicklingError(_what_is_wrong(path)) from err


def _what_is_wrong(path: Path) -> str:
    """With a file that torch cannot load as plain weights."""
    try:
        with path.open("rb") as file:
            beginning = file.read(256).lstrip(BLANKS)
    except OSError as err:
        return err.strerror or "it cannot be read"
    if not beginning:
        return "it is empty"
    if beginning.startswith(b"<"):
        return "it is a web page"
    if beginning.startswith((ARCHIVE_MAGIC, PICKLE_MAGIC)):
        return "it is damaged, or holds more than weights"
    return "it is not in torch's format"


def save_compact(network: Compact, path: Path, about: Mapping[str, str]) -> None:
    """Write the weights; `about` goes into the file's metadata."""
    save_weights(network, COMPACT, path, about)


def load_compact(path: Path = SHIPPED) -> Compact:
    """The network with the weights of a file, for inference.

    Raises:
        RecoveryError: no readable safetensors file, or not of this network.
    """
    network = Compact()
    load_weights(network, COMPACT, path)
    return network.eval()


def save_weights(network: nn.Module, name: str, path: Path, about: Mapping[str, str]) -> None:
    """Write a network's weights; its name, as in `COMPACT`, and `about` go into the file's metadata."""
    state = {key: tensor.detach().cpu().contiguous() for key, tensor in network.state_dict().items()}
    path.write_bytes(_with_sorted_metadata(save(state, {"network": name, **about})))


def _with_sorted_metadata(content: bytes) -> bytes:
    """A safetensors file's bytes, its metadata by name: the library writes them in another order each time, and equal
    weights should be equal files."""
    end = HEADER_START + int.from_bytes(content[:HEADER_START], "little")
    header = json.loads(content[HEADER_START:end])
    header["__metadata__"] = dict(sorted(header["__metadata__"].items()))
    written = json.dumps(header, separators=(",", ":"), ensure_ascii=False).encode()
    written += b" " * (-len(written) % ALIGNMENT)
    return len(written).to_bytes(HEADER_START, "little") + written + content[end:]


def load_weights(network: nn.Module, name: str, path: Path) -> None:
    """Give a network the weights that `save_weights` has written under this name.

    Raises:
        RecoveryError: no readable safetensors file, or not of this network.
    """
    expected = network.state_dict()
    try:
        with safe_open(path, framework="pt") as file:
            if (file.metadata() or {}).get("network") != name or set(file.keys()) != set(expected):
                msg = f"{path}: weights of another network than {name!r}; train it anew with this version"
                raise RecoveryError(msg)
            # Shapes are read from the header, before anything is allocated for them.
            for key, tensor in expected.items():
                shape = file.get_slice(key).get_shape()
                if list(shape) != list(tensor.shape):
                    msg = f"{path}: {key} has the shape {shape}, not {list(tensor.shape)}: train the network anew"
                    raise RecoveryError(msg)
            state = {key: file.get_tensor(key) for key in expected}
            for key, tensor in expected.items():
                if state[key].dtype != tensor.dtype:
                    msg = f"{path}: {key} is {state[key].dtype}, not {tensor.dtype}: train the network anew"
                    raise RecoveryError(msg)
    except (OSError, SafetensorError) as err:
        msg = f"{path}: no readable safetensors file ({' '.join(str(err).split())[:80]}); name one made by `train`"
        raise RecoveryError(msg) from err
    if not all(bool(torch.isfinite(tensor).all()) for tensor in state.values()):
        msg = f"{path}: holds numbers that are not finite: the training went wrong, or the file is damaged"
        raise RecoveryError(msg)
    network.load_state_dict(state)
