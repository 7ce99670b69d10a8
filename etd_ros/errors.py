"""The root of the package's errors: what a user can mend, said in one line."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

T = TypeVar("T")


class EtdError(Exception):
    """Bad input. The message names what is wrong, where, and what to do about it.

    Every area derives its own from this one; the command line prints the message and exits with 2,
    the nodes warn and count it.
    """


def named(choices: Mapping[str, T], name: str, kind: str, error: type[EtdError]) -> T:
    """The choice of this name.

    Args:
        choices: by their names.
        name: as a user gave it.
        kind: what the choices are, in a word.
        error: the class of the area's errors.

    Raises:
        EtdError: there is none, of the class given; the message lists the known ones.
    """
    if name not in choices:
        msg = f"unknown {kind} {name!r}: choose one of {', '.join(choices)}"
        raise error(msg)
    return choices[name]
