"""The interface package as ROS 2's own tools read it: Debian's python3-rosidl and catkin-pkg."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

from node.bus.messages import PACKAGE, typestore

PYTHON = "/usr/bin/python3"
"""Debian's, which has ROS's packages."""
READ = """
import json, sys
from contextlib import redirect_stdout
from pathlib import Path

from catkin_pkg.package import parse_package
from rosidl_adapter import convert_to_idl
from rosidl_parser.definition import IdlLocator, Message
from rosidl_parser.parser import parse_idl_file

package, output = Path(sys.argv[1]), Path(sys.argv[2])
messages = {}
with redirect_stdout(sys.stderr):
    for path in sorted(package.glob("msg/*.msg")):
        idl = convert_to_idl(package, "murk_msgs", Path("msg", path.name), output)
        content = parse_idl_file(IdlLocator(output, idl.relative_to(output))).content
        (message,) = content.get_elements_of_type(Message)
        messages[path.stem] = [member.name for member in message.structure.members]
    described = parse_package(package / "package.xml")
    described.validate()
groups = [group.name for group in described.member_of_groups]
print(json.dumps({"name": described.name, "groups": groups, "messages": messages}))
"""


@pytest.fixture(scope="module")
def read(tmp_path_factory: pytest.TempPathFactory) -> Any:
    check = [PYTHON, "-c", "import catkin_pkg, rosidl_adapter, rosidl_parser"]
    if not Path(PYTHON).exists() or subprocess.run(check, capture_output=True).returncode:
        pytest.skip("needs python3-rosidl and python3-catkin-pkg of Debian")
    command = [PYTHON, "-c", READ, str(PACKAGE), str(tmp_path_factory.mktemp("idl"))]
    return json.loads(subprocess.run(command, check=True, capture_output=True).stdout)


def test_package_is_one_of_interfaces(read: Any) -> None:
    assert read["name"] == "murk_msgs"
    assert read["groups"] == ["rosidl_interface_packages"]


def test_ros_reads_the_same_fields_as_the_node(read: Any) -> None:
    ours = {
        name.rpartition("/")[2]: [field for field, _ in fields]
        for name, (_, fields) in typestore().fielddefs.items()
        if name.startswith("murk_msgs/")
    }
    assert read["messages"] == ours
