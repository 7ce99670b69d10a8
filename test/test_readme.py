"""What the README promises."""

import re
import subprocess
import sys


def test_the_lines_of_python_track_a_recording(repository):
    code = re.search(r"```python\n(.*?)```", (repository / "README.md").read_text(), re.DOTALL).group(1)
    done = subprocess.run([sys.executable, "-c", code], cwd=repository, capture_output=True, text=True, check=True)
    lines = done.stdout.splitlines()
    assert len(lines) > 1000
    assert re.search(r"\d+ tin tracking Box\(x=", lines[-1])


def test_every_file_that_it_links_to_exists(repository):
    for target in re.findall(r"\]\(([^)#:]+)\)", (repository / "README.md").read_text()):
        assert (repository / target).exists(), target
