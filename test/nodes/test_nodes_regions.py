"""NZGE in the targets' search regions, with the accumulator and the tracker in two processes."""

from vision_msgs.msg import Detection2DArray

from etd_ros.cli import main
from etd_ros.evaluation import read_tracks
from msg_adapters import decode_detections

EVENTS = "/event_camera/events"
REMAP = ("-r", f"~/events:={EVENTS}")


def test_frames_are_measured_round_a_lost_target_until_its_tracker_ends(bench, data, tmp_path):
    recording, truth = data / "traffic" / "traffic.mcap", data / "traffic" / "boxes.csv"
    tracks = tmp_path / "tracks.csv"
    command = ["track", str(recording), "--targets", str(truth), "--output", str(tracks), "--method", "etd-nr"]
    assert main([*command, "--set", "atsltd.entropy_region=targets"]) == 0
    (rows,) = read_tracks(tracks).values()
    bench.listen("/tracker/search_regions", Detection2DArray)
    bench.start("accumulator", ros=(*REMAP, "-p", "atsltd.entropy_region:=targets"))
    bench.start("tracker", ros=("-p", f"targets_file:={truth}", "-p", "method:=etd-nr"))
    bench.wait_until(lambda: bench.figure("accumulator", "frame subscribers") == "1", "the nodes are linked")
    replay = bench.start("replay", str(recording), "--rate", "0.5", "--wait-for", "1")
    bench.wait_until(lambda: replay.poll() is not None, "the replay is over")
    state = "state of silver_car"
    bench.wait_until(lambda: bench.figure("tracker", state) == "lost", "the target is lost")
    bench.wait_until(
        lambda: 0 < int(bench.figure("accumulator", "frames")) == int(bench.figure("tracker", "frames tracked")),
        "every frame is tracked",
    )

    regions = [tuple(decode_detections(message).detections) for message in bench.messages["/tracker/search_regions"]]
    assert len(regions) == int(bench.figure("tracker", "frames tracked"))
    assert all(len(region) == 1 for region in regions), "a lost target is looked for where it was"
    assert regions[-1] == regions[-2]
    assert bench.figure("accumulator", "search regions") == "1"
    # Live frames depend on when the regions come; with NZGE over the whole sensor they are half as many again.
    assert abs(int(bench.figure("accumulator", "frames")) - len(rows)) < len(rows) / 4

    assert bench.end("tracker") == 0
    bench.wait_until(lambda: bench.figure("accumulator", "search regions") == "0", "the accumulator forgets them")
