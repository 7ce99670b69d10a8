"""The cursors: fields in both layouts as struct writes them, and heads that are not little-endian CDR."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msg_oracles import Bytes

from msg_adapters import Layout, MessageError
from msg_adapters.layout import Reader, Writer

CODES = {"u8": "B", "u32": "I", "i32": "i", "u64": "Q", "f64": "d"}
FIELDS = st.lists(
    st.one_of(
        st.tuples(st.just("u8"), st.integers(0, 2**8 - 1)),
        st.tuples(st.just("u32"), st.integers(0, 2**32 - 1)),
        st.tuples(st.just("i32"), st.integers(-(2**31), 2**31 - 1)),
        st.tuples(st.just("u64"), st.integers(0, 2**64 - 1)),
        st.tuples(st.just("f64"), st.floats(allow_nan=False)),
        st.tuples(st.just("string"), st.text(max_size=6).filter(lambda text: "\0" not in text)),
    ),
    max_size=12,
)


@settings(deadline=None, max_examples=60)
@given(FIELDS, st.sampled_from(Layout))
def test_fields_are_read_and_written_where_the_layout_puts_them(fields, layout):
    expected, writer = Bytes(layout), Writer(layout)
    for name, value in fields:
        getattr(writer, name)(value)
        if name == "string":
            expected.text(value)
        else:
            expected.put(CODES[name], value)
    assert len(writer.finish()) == len(expected.done())
    for message in (writer.finish(), expected.done()):
        reader = Reader(message, layout)
        assert [getattr(reader, name)() for name, _ in fields] == [value for _, value in fields]
        assert reader.remaining == 0


@pytest.mark.parametrize(
    ("head", "text"), [("00000000", "big-endian"), ("00030000", "ROS 1"), ("2a000000", "ROS 1"), ("0001", "cut short")]
)
def test_other_heads_than_little_endian_cdr_are_refused(head, text):
    with pytest.raises(MessageError, match=text):
        Reader(bytes.fromhex(head), Layout.ROS2)


def test_a_string_without_its_nul_is_refused():
    with pytest.raises(MessageError, match="NUL"):
        Reader(b"\0\1\0\0\2\0\0\0ab", Layout.ROS2).string()


def test_a_string_of_length_0_is_empty():
    assert Reader(b"\0\1\0\0\0\0\0\0", Layout.ROS2).string() == ""


def test_a_string_that_is_not_utf_8_is_refused():
    with pytest.raises(MessageError, match="UTF-8"):
        Reader(b"\2\0\0\0\xff\xff", Layout.ROS1).string()


@pytest.mark.parametrize(("field", "value"), [("u8", 256), ("u32", -1), ("i32", 2**31), ("u64", 2**64)])
def test_values_that_do_not_fit_their_field_are_refused(field, value):
    with pytest.raises(MessageError, match="does not fit"):
        getattr(Writer(), field)(value)
