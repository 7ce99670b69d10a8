"""Parameter files that are no YAML in ways that PyYAML does not call so."""

import pytest

from etd_ros.parameters import ParameterError
from etd_ros.settings import read_parameter_file


@pytest.mark.parametrize(
    "text",
    [
        "/**: {ros__parameters: {tracking: {failure_iou: 2020-13-45}}}",
        "a: " + "9" * 5000,
        "a: " + "[" * 3000,
        "a: &a {b: *a}",
    ],
    ids=["impossible date", "endless number", "endless nesting", "a mapping inside itself"],
)
def test_a_file_that_cannot_be_understood_is_named(tmp_path, text):
    path = tmp_path / "parameters.yaml"
    path.write_text(text)
    with pytest.raises(ParameterError, match="parameters.yaml: is not YAML"):
        read_parameter_file(path)
