import http.client
import json
import socket
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from labelling_recordings import PICTURES, serving, write_recording

import etd_ros.labelling
from etd_ros.labelling import LabellingError
from etd_ros.labelling.server import PAGE_TYPES

EDIT = {"action": "box", "target": "ball", "picture": 2, "box": [1, 2, 3, 4]}
JSON = {"Content-Type": "application/json"}


@pytest.fixture
def served(tmp_path):
    with serving(write_recording(tmp_path / "a"), tmp_path / "boxes.csv") as server:
        yield server, tmp_path / "boxes.csv"


def asked(url, method, name, body=None, headers=None):
    """(status, content) of a request for a path below the page's address, or an absolute one."""
    parts = urlsplit(url)
    connection = http.client.HTTPConnection(parts.hostname, parts.port, timeout=10)
    try:
        path = name if name.startswith("/") else parts.path + name
        connection.request(method, path, None if body is None else json.dumps(body), headers or {})
        answer = connection.getresponse()
        return answer.status, answer.read()
    finally:
        connection.close()


def test_page_pictures_and_labels_are_served_below_the_token(served):
    server, _ = served
    for name in ("", *PAGE_TYPES):
        status, content = asked(server.url, "GET", name)
        assert status == 200
        assert content
    status, png = asked(server.url, "GET", "pictures/3")
    assert (status, png[:4]) == (200, b"\x89PNG")
    sequence = json.loads(asked(server.url, "GET", "sequence")[1])
    assert (sequence["title"], sequence["kind"], len(sequence["times_s"])) == ("a", "video", PICTURES)
    assert json.loads(asked(server.url, "GET", "labels")[1])["targets"] == []


def test_all_files_of_the_page_are_served():
    folder = Path(etd_ros.labelling.__file__).parent / "page"
    assert sorted(PAGE_TYPES) == sorted(path.name for path in folder.iterdir())


def test_the_page_loads_nothing_from_elsewhere():
    folder = Path(etd_ros.labelling.__file__).parent / "page"
    for path in folder.iterdir():
        assert "//" not in path.read_text().replace("// ", "").replace("=>", ""), path.name


def test_changes_are_made_and_saved(served):
    server, output = served
    status, content = asked(server.url, "POST", "edit", EDIT, JSON)
    assert (status, json.loads(content)["targets"][0]["boxes"][2]) == (200, [1, 2, 3, 4])
    status, content = asked(server.url, "POST", "save", {}, JSON)
    assert (status, json.loads(content)["is_saved"]) == (200, True)
    assert output.read_text().splitlines()[1] == "ball,200000000,1.000,2.000,3.000,4.000"


@pytest.mark.parametrize("name", ["/", "/labels", "/wrong/labels", "/wrong/", "//labels"])
def test_without_the_token_nothing_is_told(served, name):
    server, _ = served
    for method in ("GET", "POST"):
        status, content = asked(server.url, method, name, {} if method == "POST" else None, JSON)
        assert status == 403
        assert b"targets" not in content


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1:1", ""])
def test_another_name_for_this_machine_is_refused(served, host):
    server, _ = served
    assert asked(server.url, "GET", "labels", headers={"Host": host})[0] == 403


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({**JSON, "Origin": "http://evil.example"}, 403),
        ({**JSON, "Origin": "null"}, 403),
        ({"Content-Type": "text/plain"}, 415),
        ({"Content-Type": "application/x-www-form-urlencoded"}, 415),
        ({**JSON, "Content-Length": "100000000"}, 413),
        ({**JSON, "Content-Length": "-1"}, 413),
    ],
)
def test_changes_from_elsewhere_are_refused(served, headers, status):
    server, _ = served
    assert asked(server.url, "POST", "edit", EDIT, headers)[0] == status
    assert json.loads(asked(server.url, "GET", "labels")[1])["targets"] == []


@pytest.mark.parametrize(
    "name", ["pictures/11", "pictures/x", "pictures/", "../label.py", "page/index.html", "nothing"]
)
def test_what_is_not_there_is_not_found(served, name):
    server, _ = served
    assert asked(server.url, "GET", name)[0] == 404
    assert asked(server.url, "POST", name, {}, JSON)[0] == 404


def test_a_change_that_makes_no_sense_is_refused_with_the_reason(served):
    server, _ = served
    status, content = asked(server.url, "POST", "edit", {**EDIT, "picture": 99}, JSON)
    assert (status, json.loads(content)) == (400, {"error": "there is no picture 99"})
    assert asked(server.url, "POST", "edit", [1], JSON)[0] == 400


def test_only_this_machine_is_listened_to(served):
    server, _ = served
    assert urlsplit(server.url).hostname == "127.0.0.1"
    port = urlsplit(server.url).port
    with socket.socket() as other:
        # Another loopback address stands for another of the machine's interfaces.
        assert other.connect_ex(("127.0.0.2", port)) != 0


def test_each_server_has_a_token_of_its_own(tmp_path, served):
    with serving(write_recording(tmp_path / "b"), tmp_path / "others.csv") as other:
        assert urlsplit(other.url).path != urlsplit(served[0].url).path


def test_a_port_that_is_taken_is_named(tmp_path, served):
    from etd_ros.labelling import LabelServer

    port = urlsplit(served[0].url).port
    for wanted in (port, 70000):
        with pytest.raises(LabellingError, match=f"port {wanted} cannot be used"):
            LabelServer(None, None, title="", port=wanted)
