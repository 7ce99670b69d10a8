"""Files that name a sensor size that no sensor has."""

import numpy as np
import pytest
from recording_writers import write_raw

from etd_ros.recordings import RecordingError, open_recording


@pytest.mark.parametrize("size", ["0x480", "640x65536", "99999999999x5"])
def test_a_raw_file_of_an_impossible_size_is_named(tmp_path, size):
    path = write_raw(tmp_path / "odd.raw", f"% evt 3.0\n% geometry {size}\n% end\n", np.zeros(4, "<u2"))
    with pytest.raises(RecordingError, match=f"odd.raw: sensor size {size} is impossible.*--size"):
        open_recording(path)


@pytest.mark.parametrize("size", ["70000x5", "60000x60000"])
def test_a_text_of_an_impossible_size_is_named(tmp_path, size):
    path = tmp_path / "odd.txt"
    path.write_text(f"{size.replace('x', ' ')}\n1.0 1 1 1\n")
    with pytest.raises(RecordingError, match=f"odd.txt: sensor size {size} is impossible"):
        open_recording(path)
