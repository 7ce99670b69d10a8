"""Whether kernels are being compiled, or only loaded from where they were kept."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from numba.core.event import Event, Listener, install_listener

COMPILING = "numba:compile"
"""The compiler's name for what it does where it finds nothing kept."""


class _First(Listener):
    """Hears of each kernel, and tells of the first."""

    def __init__(self, tell: Callable[[], object]) -> None:
        self._tell: Callable[[], object] | None = tell

    def on_start(self, _: Event) -> None:
        if self._tell is not None:
            tell, self._tell = self._tell, None
            tell()

    def on_end(self, _: Event) -> None:
        pass


@contextmanager
def compile_notice(tell: Callable[[], object]) -> Iterator[None]:
    """For the length of a `with` block: `tell` is called once, as the first kernel is about to be compiled."""
    with install_listener(COMPILING, _First(tell)):
        yield
