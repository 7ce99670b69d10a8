"""What targets and their classes may be called, wherever they are named: in files, messages and pages."""

from __future__ import annotations

NAME_LENGTH_MAX = 64
NAME_RULE = f"1 to {NAME_LENGTH_MAX} printable characters without commas, line breaks, or blanks at the ends"
CLASS_RULE = f"at most {NAME_LENGTH_MAX} printable characters"


def is_name(name: str) -> bool:
    """Whether it names a target, by NAME_RULE: it stands in a column of files whose columns are parted by commas."""
    return 1 <= len(name) <= NAME_LENGTH_MAX and name.isprintable() and "," not in name and name == name.strip()


def is_class(class_id: str) -> bool:
    """Whether it is a target's class, by CLASS_RULE; it may be empty."""
    return len(class_id) <= NAME_LENGTH_MAX and class_id.isprintable()
