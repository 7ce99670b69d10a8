"""ONNX files of small networks, written byte by byte: the package that makes such files is large, and not needed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

Shape = tuple[int, ...]
FLOAT, INTS = 1, 7
"""Kinds of values, and of a node's attributes."""


def other_network() -> bytes:
    """A network that OpenCV loads, and none of its trackers can use."""
    return _model(
        [_convolution("input", "output", "weights", 4)],
        {"weights": _noise((4, 3, 4, 4), 0.1)},
        {"input": (1, 3, 64, 64)},
        {"output": (1, 4, 16, 16)},
    )


def tiny_vit() -> bytes:
    """A network with the inputs and outputs of Vit's, which has learnt nothing."""
    maps = {"output1": 1, "output2": 2, "output3": 2}
    nodes, weights = [], {"template_weights": _noise((1, 3, 128, 128), 0.001), "zero": np.zeros(1, np.float32)}
    nodes.append(_convolution("template", "seen", "template_weights", 128))
    nodes.append(_node("Mul", ["seen", "zero"], "unheeded"))
    for name, channels in maps.items():
        weights[f"{name}_weights"] = _noise((channels, 3, 16, 16), 0.01)
        nodes.append(_convolution("search", f"{name}_raw", f"{name}_weights", 16))
        nodes.append(_node("Sigmoid", [f"{name}_raw"], f"{name}_share"))
        nodes.append(_node("Add", [f"{name}_share", "unheeded"], name))
    return _model(
        nodes,
        weights,
        {"template": (1, 3, 128, 128), "search": (1, 3, 256, 256)},
        {name: (1, channels, 16, 16) for name, channels in maps.items()},
    )


def _noise(shape: Shape, spread: float) -> np.ndarray:
    return np.random.default_rng(0).normal(0, spread, shape).astype(np.float32)


def _model(
    nodes: Sequence[bytes], weights: dict[str, np.ndarray], inputs: dict[str, Shape], outputs: dict[str, Shape]
) -> bytes:
    graph = b"".join(_bytes(1, node) for node in nodes) + _bytes(2, b"network")
    graph += b"".join(_bytes(5, _tensor(name, values)) for name, values in weights.items())
    graph += b"".join(_bytes(11, _value(name, shape)) for name, shape in inputs.items())
    graph += b"".join(_bytes(12, _value(name, shape)) for name, shape in outputs.items())
    return _number(1, 7) + _bytes(7, graph) + _bytes(8, _bytes(1, b"") + _number(2, 11))


def _convolution(source: str, result: str, weights: str, side: int) -> bytes:
    """Of squares that lie side by side."""
    sides = {"kernel_shape": [side, side], "strides": [side, side]}
    attributes = b"".join(
        _bytes(5, _bytes(1, name.encode()) + b"".join(_number(8, value) for value in values) + _number(20, INTS))
        for name, values in sides.items()
    )
    return _node("Conv", [source, weights], result) + attributes


def _node(operator: str, sources: Sequence[str], result: str) -> bytes:
    named = b"".join(_bytes(1, source.encode()) for source in sources)
    return named + _bytes(2, result.encode()) + _bytes(4, operator.encode())


def _tensor(name: str, values: np.ndarray) -> bytes:
    dimensions = b"".join(_number(1, size) for size in values.shape)
    return dimensions + _number(2, FLOAT) + _bytes(8, name.encode()) + _bytes(9, values.tobytes())


def _value(name: str, shape: Shape) -> bytes:
    dimensions = b"".join(_bytes(1, _number(1, size)) for size in shape)
    return _bytes(1, name.encode()) + _bytes(2, _bytes(1, _number(1, FLOAT) + _bytes(2, dimensions)))


def _number(field: int, value: int) -> bytes:
    return _varint(field << 3) + _varint(value)


def _bytes(field: int, content: bytes) -> bytes:
    return _varint(field << 3 | 2) + _varint(len(content)) + content


def _varint(value: int) -> bytes:
    parts = []
    while value >= 128:
        parts.append(value & 127 | 128)
        value >>= 7
    return bytes([*parts, value])
