"""Preconditioned conjugate gradients that go on where they stopped when the problem changes a little."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from etd_ros.systems.eco.fourier import inner

Vector = list[npt.NDArray[Any]]
"""An unknown in parts: spectra and real matrices."""


class LeastSquares(Protocol):
    """A symmetric positive definite system of linear equations."""

    def apply(self, x: Vector) -> Vector:
        """The system's matrix times x."""
        ...

    def precondition(self, x: Vector) -> Vector:
        """About the inverse of the matrix times x; itself symmetric and positive definite."""
        ...

    def right_side(self) -> Vector:
        """What `apply` of the solution is."""
        ...


@dataclass(slots=True)
class Momentum:
    """The last search direction, the last residual, and that one's squared preconditioned length."""

    direction: Vector
    residual: Vector
    squared: float


def solve(
    system: LeastSquares, start: Vector, iterations: int, momentum: Momentum | None = None, forget: float = 1.0
) -> tuple[Vector, Momentum | None]:
    """A few iterations from `start` towards the solution.

    Polak-Ribiere's formula for the next direction, which falls back to the steepest descent when the system has
    changed; the direction of an earlier call is gone on with (ECO: Danelljan et al., CVPR 2017, Section 3.3).

    Args:
        system: what to solve.
        start: the first guess; not changed.
        iterations: how many; fewer when the solution is reached.
        momentum: what an earlier call returned.
        forget: 0 to 1, how much of it still counts.

    Returns:
        The last guess, and what a later call can start from; None where start is a solution.
    """
    x = [part.copy() for part in start]
    residual = _added(system.right_side(), system.apply(x), -1)
    kept = forget
    for _ in range(iterations):
        steepest = system.precondition(residual)
        squared = _inner(residual, steepest)
        if squared <= np.finfo(np.float64).tiny:
            break
        direction = steepest
        if momentum is not None:
            beta = (squared - _inner(momentum.residual, steepest)) / momentum.squared
            direction = _added(steepest, momentum.direction, kept * max(beta, 0))
        image = system.apply(direction)
        curvature = _inner(direction, image)
        if curvature <= 0:
            break
        length = squared / curvature
        x = _added(x, direction, length)
        momentum, kept = Momentum(direction, residual, squared), 1.0
        residual = _added(residual, image, -length)
    return x, momentum


def _inner(a: Vector, b: Vector) -> float:
    return sum(inner(part, other) for part, other in zip(a, b, strict=True))


def _added(a: Vector, b: Vector, factor: float) -> Vector:
    return [part + np.float32(factor) * other for part, other in zip(a, b, strict=True)]
