import cv2
import numpy as np
import pytest
from labelling_recordings import HEIGHT, PICTURES, STAMPS, WIDTH, write_recording

from etd_ros.labelling import LabellingError, Pictures, make_pictures
from etd_ros.reconstruction import HighPassConfig, HighPassFilter
from etd_ros.recordings import open_recording


def decoded(png):
    return cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)


def test_video_frames_are_shown_where_there_are_any(tmp_path):
    with open_recording(write_recording(tmp_path / "a")) as recording, make_pictures(recording) as pictures:
        assert (pictures.kind, pictures.width, pictures.height) == ("video", WIDTH, HEIGHT)
        assert pictures.stamps.tolist() == STAMPS
        for number, image in enumerate(recording.images()):
            assert (decoded(pictures.png(number)) == image.data).all()


def test_without_video_the_events_are_reconstructed(tmp_path):
    recorded = write_recording(tmp_path / "a", with_images=False)
    with open_recording(recorded) as recording, make_pictures(recording, rate_hz=20) as pictures:
        assert pictures.kind == "reconstruction"
        first_ns = int(next(recording.events()).t[0])
        last_ns = max(int(batch.t[-1]) for batch in recording.events())
        steps = (last_ns - first_ns) // 50_000_000
        assert pictures.stamps.tolist() == [first_ns + 50_000_000 * number for number in range(1, steps + 1)]


def test_a_reconstruction_holds_the_events_before_its_stamp(tmp_path):
    with open_recording(write_recording(tmp_path / "a")) as recording:
        high_pass = HighPassFilter(WIDTH, HEIGHT, HighPassConfig())
        with make_pictures(recording, "reconstruction", rate_hz=4) as pictures:
            first_ns = int(pictures.stamps[0])
            for batch in recording.events():
                high_pass.integrate(batch[: int(np.searchsorted(batch.t, first_ns))])
            assert (decoded(pictures.png(0)) == high_pass.image(first_ns)).all()


def test_real_recordings_have_pictures_on_the_events_clock(data):
    with open_recording(data / "slider_depth" / "slider_depth.bag") as recording, make_pictures(recording) as pictures:
        first_ns = int(next(recording.events()).t[0])
        assert len(pictures) == 87
        assert abs(int(pictures.stamps[0]) - first_ns) < 10**8


@pytest.mark.parametrize(
    ("kind", "rate_hz", "with_images", "message"),
    [
        ("video", 30, False, "no video picture to label: try --on reconstruction"),
        ("reconstruction", 0.1, True, "try a higher --rate"),
        ("reconstruction", 0, True, "--rate 0 is out of range"),
        ("reconstruction", float("nan"), True, "--rate nan is out of range"),
        ("reconstruction", 1e9, True, "is out of range"),
    ],
)
def test_what_leaves_nothing_to_label_is_refused(tmp_path, kind, rate_hz, with_images, message):
    recorded = write_recording(tmp_path / "a", with_images=with_images)
    with open_recording(recorded) as recording, pytest.raises(LabellingError, match=message):
        make_pictures(recording, kind, rate_hz=rate_hz)


def test_a_pause_of_years_is_not_filled_with_pictures(tmp_path):
    (tmp_path / "events.txt").write_text("0.1 1 1 1\n900000000.0 1 1 1\n")
    with open_recording(tmp_path) as recording, pytest.raises(LabellingError, match="more than 200000 pictures"):
        make_pictures(recording)


def test_video_frames_of_another_camera_are_refused(tmp_path):
    recorded = write_recording(tmp_path / "a")
    for file in (recorded / "images").iterdir():
        cv2.imwrite(str(file), np.zeros((2 * HEIGHT, 2 * WIDTH), np.uint8))
    with open_recording(recorded) as recording, pytest.raises(LabellingError, match="video frames of 160x120 beside"):
        make_pictures(recording)


def test_frames_that_step_back_in_time_are_left_out():
    with Pictures("video", 4, 4) as pictures:
        for stamp_ns in (5, 6, 6, 2, 7):
            pictures.add(stamp_ns, np.full((4, 4), stamp_ns, np.uint8))
        pictures.finish()
        assert pictures.stamps.tolist() == [5, 6, 7]
        assert [int(decoded(pictures.png(number))[0, 0]) for number in range(3)] == [5, 6, 7]
        for number in (-1, 3):
            with pytest.raises(IndexError):
                pictures.png(number)


def test_pixels_of_all_kinds_become_eight_bit():
    with Pictures("video", 4, 4) as pictures:
        pictures.add(1, np.full((4, 4), 0x1234, np.uint16))
        pictures.add(2, np.dstack([np.full((4, 4), 10, np.uint8), np.full((4, 4), 20, np.uint8)]))
        pictures.add(3, np.full((4, 4, 3), (1, 2, 3), np.uint8))
        pictures.finish()
        assert [decoded(pictures.png(number))[0, 0].tolist() for number in range(3)] == [0x12, 20, [1, 2, 3]]


def test_every_picture_is_served_whatever_their_number(tmp_path):
    with open_recording(write_recording(tmp_path / "a")) as recording, make_pictures(recording) as pictures:
        assert [int(np.argmax(decoded(pictures.png(number))[0])) // 2 for number in range(PICTURES)] == list(
            range(PICTURES)
        )
