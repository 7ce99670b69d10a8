"""The compiled message packages are wire compatible with the released ones."""

import json
import re
from importlib.util import find_spec
from pathlib import Path

import pytest

RELEASED_TYPE_HASHES = {
    "event_camera_msgs/EventPacket": "d6fa176260b1f37e5a40845305315e150a0f18191241eb64f407442aa29844aa",
    "event_array_msgs/EventArray": "4d9e7f80b4b36e539f2691dbbc8066ff7d58d64981df6cb2b04fd305ee436030",
    "dvs_msgs/Event": "51cfc8e311acf01bf39b01e0e8f2fee8f9fa97e7979cf505c0610c8a8bc3fc3a",
    "dvs_msgs/EventArray": "0ea4aa5f4670adab1336550158b2e3c9bf60fe515a284c4215ed605bd559c995",
    "prophesee_event_msgs/EventArray": "9581cad55eb44695901e91e5b4483e859f082498085746d6dfb2a8f3bac7ce18",
    "dv_ros2_msgs/EventArray": "7229a714a38d8734ad1b620630deffc4e56cd8335ca90dac2aa5d0251f78178c",
    "vision_msgs/Detection2DArray": "214274120007f4a683866481336b70310268cfa107aebe9d594a6acf75bda968",
    "vision_msgs/Detection2D": "0d12b69df5c593b3455b7346fac8205437a7d4bcb09b9e0e0b2dde787ded38ea",
    "vision_msgs/BoundingBox2D": "008eacbb0cf8f26e83795547bed013eec3675485ef386ec056d80eaaf1c1ce2f",
}


@pytest.mark.parametrize("name", RELEASED_TYPE_HASHES)
def test_an_installed_message_has_the_type_hash_of_the_released_one(name: str) -> None:
    package, message = name.split("/")
    spec = find_spec(package)
    assert spec is not None, f"{package} is not installed: run make setup"
    assert spec.origin is not None
    # PREFIX/lib/pythonX.Y/site-packages/PACKAGE/__init__.py
    prefix = Path(spec.origin).parents[4]
    description = json.loads((prefix / "share" / package / "msg" / f"{message}.json").read_text())
    hashes = {entry["type_name"]: entry["hash_string"] for entry in description["type_hashes"]}
    assert hashes[f"{package}/msg/{message}"] == f"RIHS01_{RELEASED_TYPE_HASHES[name]}"


def test_colcon_is_told_to_leave_the_interfaces_alone(repository: Path) -> None:
    assert (repository / "interfaces" / "COLCON_IGNORE").is_file()


def test_each_interface_package_compiles_all_its_messages(repository: Path) -> None:
    packages = [path.parent for path in (repository / "interfaces").glob("*/package.xml")]
    assert {package.name for package in packages} == {name.split("/")[0] for name in RELEASED_TYPE_HASHES}
    for package in packages:
        compiled = re.findall(r'"msg/(\w+)\.msg"', (package / "CMakeLists.txt").read_text())
        assert sorted(compiled) == sorted(path.stem for path in package.glob("msg/*.msg"))
