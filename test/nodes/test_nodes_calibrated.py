"""The nodes read what `calibrate` writes."""

import pytest
from sensor_msgs.msg import Image

from etd_ros.cli import main
from etd_ros.conversion import PAPER_INTERVAL, AtsltdConverter
from etd_ros.recordings import open_recording
from etd_ros.settings import read_parameter_file, settings_from_mapping
from msg_adapters import decode_image


@pytest.mark.parametrize("conversion", ["atsltd_fine", "atsltd"])
def test_the_accumulator_ends_its_frames_as_the_calibrated_file_says(bench, repository, tmp_path, conversion):
    recording, parameters = repository / "bags" / "demo", tmp_path / "sensor.yaml"
    assert main(["calibrate", str(recording), "--output", str(parameters)]) == 0
    config = settings_from_mapping(read_parameter_file(parameters)).atsltd
    assert config.nzge_interval != PAPER_INTERVAL
    with open_recording(recording) as opened:
        frame_config = config.fine() if conversion == "atsltd_fine" else config
        converter = AtsltdConverter(opened.width, opened.height, frame_config)
        expected = [frame.stamp_ns for batch in opened.streams() for frame in converter.convert(batch.events)]
    bench.listen("/accumulator/frames", Image)
    arguments = ("--params-file", str(parameters), "-p", f"conversion:={conversion}")
    bench.start("accumulator", ros=(*arguments, "-r", "~/events:=/event_camera/events"))
    bench.wait_until(lambda: bench.figure("accumulator", "frame subscribers") == "1", "the accumulator is linked")
    bench.start("replay", str(recording), "--rate", "2", "--wait-for", "1")
    frames = bench.messages["/accumulator/frames"]
    bench.wait_until(lambda: len(frames) >= len(expected), "every frame has come")
    assert [decode_image(message).stamp_ns for message in frames] == expected
