"""Images: round trips in both layouts, against real ROS 2, and senders that are wrong about their sizes."""

import array
import sys

import numpy as np
import pytest
from msg_oracles import Bytes
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Image

from msg_adapters import Layout, MessageError, decode_image, encode_image

RANDOM = np.random.default_rng(1)
PIXELS = {
    "mono8": RANDOM.integers(0, 256, (5, 7), np.uint8),
    "8UC1": RANDOM.integers(0, 256, (5, 7), np.uint8),
    "8UC2": RANDOM.integers(0, 256, (5, 7, 2), np.uint8),
    "bgr8": RANDOM.integers(0, 256, (5, 7, 3), np.uint8),
    "rgb8": RANDOM.integers(0, 256, (5, 7, 3), np.uint8),
    "mono16": RANDOM.integers(0, 65536, (5, 7), np.uint16),
    "16UC1": RANDOM.integers(0, 65536, (5, 7), np.uint16),
}
EVERY_ENCODING = pytest.mark.parametrize("encoding", sorted(PIXELS))


def image(data=bytes(12), *, layout=Layout.ROS2, height=3, width=4, encoding="mono8", is_bigendian=False, step=4):
    message = Bytes(layout).header(7, "cam").put("I", height, width).text(encoding)
    return message.put("B", is_bigendian).put("I", step).blob(data).done()


@EVERY_ENCODING
def test_an_image_returns_as_it_was(encoding):
    decoded = decode_image(encode_image(PIXELS[encoding], stamp_ns=3, frame_id="c", encoding=encoding))
    assert (decoded.stamp_ns, decoded.frame_id, decoded.encoding) == (3, "c", encoding)
    assert decoded.data.dtype == PIXELS[encoding].dtype
    np.testing.assert_array_equal(decoded.data, PIXELS[encoding])


@EVERY_ENCODING
def test_real_ros_2_reads_the_images_written_here_and_the_other_way_round(encoding):
    pixels = PIXELS[encoding]
    message = encode_image(pixels, stamp_ns=2_000_000_001, frame_id="cam", encoding=encoding)
    read = deserialize_message(message, Image)
    assert (read.header.stamp.sec, read.header.stamp.nanosec, read.header.frame_id) == (2, 1, "cam")
    assert (read.height, read.width, read.encoding, read.is_bigendian) == (5, 7, encoding, 0)
    assert (read.step, bytes(read.data)) == (pixels.nbytes // 5, pixels.tobytes())
    decoded = decode_image(serialize_message(read))
    np.testing.assert_array_equal(decoded.data, pixels)


@pytest.mark.parametrize(
    ("encoding", "name"), [("mono8", "mono8"), ("8UC2", "8UC2"), ("bgr8", "bgr8"), ("mono16", "mono16")]
)
def test_the_encoding_follows_from_the_array(encoding, name):
    assert decode_image(encode_image(PIXELS[encoding], stamp_ns=0, frame_id="")).encoding == name


def test_an_array_with_gaps_is_written_as_it_looks():
    pixels = PIXELS["bgr8"][::2, ::-1]
    np.testing.assert_array_equal(decode_image(encode_image(pixels, stamp_ns=0, frame_id="")).data, pixels)


@pytest.mark.parametrize("layout", Layout)
def test_rows_with_padding_are_read_without_it_and_without_a_copy(layout):
    message = image(bytes(range(18)), layout=layout, step=7)
    decoded = decode_image(message, layout)
    assert decoded.data.tolist() == [[0, 1, 2, 3], [7, 8, 9, 10], [14, 15, 16, 17]]
    assert np.shares_memory(decoded.data, np.frombuffer(message, np.uint8))
    assert not decoded.data.flags.writeable


@pytest.mark.parametrize("layout", Layout)
def test_an_image_cut_at_any_byte_is_refused(layout):
    message = image(layout=layout)
    for size in range(len(message)):
        with pytest.raises(MessageError):
            decode_image(message[:size], layout)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"encoding": "yuv422"}, "bgr8"),
        ({"step": 3}, "rows of 3"),
        ({"height": 4}, "do not hold"),
        ({"height": 0}, r"1\.\.65535"),
        ({"width": 2**31}, r"1\.\.65535"),
        ({"encoding": "mono16", "width": 2, "is_bigendian": True}, "big-endian"),
    ],
)
def test_an_image_that_cannot_be_is_refused_with_the_reason(change, text):
    with pytest.raises(MessageError, match=text):
        decode_image(image(**change))


@pytest.mark.parametrize(
    ("pixels", "encoding"),
    [
        (np.zeros((2, 2), np.float32), None),
        (np.zeros((2, 2, 4), np.uint8), None),
        (np.zeros(4, np.uint8), None),
        (np.zeros((2, 2), np.uint8), "bgr8"),
        (np.zeros((2, 2), np.uint8), "nonsense"),
        (np.zeros((0, 2), np.uint8), None),
    ],
)
def test_arrays_that_are_no_images_are_refused(pixels, encoding):
    with pytest.raises(MessageError):
        encode_image(pixels, stamp_ns=0, frame_id="", encoding=encoding)


def test_the_message_owns_its_pixels():
    pixels = PIXELS["mono8"].copy()
    message = encode_image(pixels, stamp_ns=0, frame_id="")
    before = decode_image(message).data.copy()
    pixels += 1
    np.testing.assert_array_equal(decode_image(message).data, before)
    assert sys.getsizeof(message) < 200


def test_a_received_array_field_is_a_message_too():
    message = array.array("B", image())
    assert decode_image(memoryview(message)).data.shape == (3, 4)
