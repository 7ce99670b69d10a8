"""Settings under the names that nodes, files and the command line share."""

import pytest
import yaml

from etd_ros.commands.parameters import parameter_table, parameter_yaml
from etd_ros.parameters import ParameterError
from etd_ros.settings import Settings, described_settings, read_parameter_file, settings_from_mapping


def test_a_value_reaches_its_stage():
    settings = settings_from_mapping({"tracking.failure_iou": 0.4, "detection.search_scale": 2})
    assert settings.tracking.failure_iou == 0.4
    assert settings.detection.search_scale == 2.0
    assert settings.atsltd == Settings().atsltd


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"failure_iou": 0.4}, r"unknown parameter 'failure_iou' \(is tracking.failure_iou meant\?\): `.* parameters`"),
        ({"xyzzy": 1}, "unknown parameter 'xyzzy': `python -m etd_ros parameters` lists them"),
        ({"tracking.failure_oui": 0.4}, r"tracking: unknown parameter 'failure_oui' \(is failure_iou meant\?\)"),
        ({"tracking.failure_iou": 1.4}, "tracking: parameter failure_iou = 1.4 is out of range"),
    ],
)
def test_wrong_settings_are_named(values, words):
    with pytest.raises(ParameterError, match=words):
        settings_from_mapping(values)


def test_every_parameter_has_a_meaning():
    for name, _, description in described_settings():
        assert len(description.text) > 10, name


def test_the_shipped_parameter_file_holds_the_defaults(repository):
    path = repository / "config" / "etd_ros.yaml"
    assert path.read_text() == parameter_yaml(), (
        "make it anew: python -m etd_ros parameters --yaml > config/etd_ros.yaml"
    )
    assert settings_from_mapping(read_parameter_file(path)) == Settings()
    assert yaml.safe_load(path.read_text())["/**"]["ros__parameters"]["tracking"]["failure_iou"] == 0.3


def test_the_readme_lists_every_parameter(repository):
    assert parameter_table() in (repository / "README.md").read_text(), "paste: python -m etd_ros parameters"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: [", "is not YAML"),
        ("a: 1", "holds no ros__parameters"),
        ("", "holds no ros__parameters"),
        ("/**: {ros__parameters: {tagets: 1, bias: {x: 2}}}", "holds no parameter of the method"),
        ("/**: {ros__parameters: {nose_filter: {window_s: 0.1}}}", "is noise_filter.window_s meant"),
    ],
)
def test_a_parameter_file_that_is_none_is_named(tmp_path, text, words):
    path = tmp_path / "parameters.yaml"
    path.write_text(text)
    with pytest.raises(ParameterError, match=words) as caught:
        read_parameter_file(path)
    assert str(path) in str(caught.value)


def test_what_a_parameter_file_holds_for_other_nodes_is_passed_over(tmp_path):
    path = tmp_path / "parameters.yaml"
    path.write_text(
        "/**: {ros__parameters: {auto: true, noise_filter: {window_s: 0.1}}}\n"
        "/camera: {ros__parameters: {bias: {diff_on: 2}, filter: {window_s: 1.0},"
        " qos_overrides: {/events: {publisher: {depth: 5}}}}}\n"
    )
    assert read_parameter_file(path) == {"noise_filter.window_s": 0.1}


def test_a_missing_parameter_file_is_named(tmp_path):
    with pytest.raises(ParameterError, match="cannot be read"):
        read_parameter_file(tmp_path / "none.yaml")
