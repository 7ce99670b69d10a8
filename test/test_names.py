"""What targets and classes may be called."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd_ros.names import NAME_LENGTH_MAX, is_class, is_name


@pytest.mark.parametrize("name", ["ball", "red ball 2", "Mütze", "x" * NAME_LENGTH_MAX])
def test_printable_words_are_names_and_classes(name):
    assert is_name(name)
    assert is_class(name)


@pytest.mark.parametrize("name", ["", " ball", "ball ", "a,b", "two\nlines", "\x00", "x" * (NAME_LENGTH_MAX + 1)])
def test_what_would_break_a_row_or_looks_like_another_is_no_name(name):
    assert not is_name(name)


def test_a_class_may_be_empty_but_is_short_and_printable():
    assert is_class("")
    assert not is_class("two\nlines")
    assert not is_class("x" * (NAME_LENGTH_MAX + 1))


@given(st.text(max_size=80))
def test_a_name_is_one_column_of_one_line(name):
    if is_name(name):
        assert f"{name},0".split(",") == [name, "0"]
        assert f"{name},0".splitlines() == [f"{name},0"]
