"""The layouts are those of the binary."""

import ctypes
import json
import subprocess

from hapfic import messages


def test_module_is_what_the_binary_prints(program):
    printed = subprocess.run([program, "schema", "--messages", "python"], capture_output=True, text=True, check=True).stdout
    with open(messages.__file__) as file:
        assert file.read() == printed


def test_layouts_are_those_of_rust(program):
    printed = subprocess.run([program, "schema", "--messages", "json"], capture_output=True, text=True, check=True).stdout
    structs = json.loads(printed)["structs"]
    assert len(structs) == len(messages.LAYOUTS) > 10
    for struct in structs:
        kind = getattr(messages, struct["name"])
        assert ctypes.sizeof(kind) == struct["size"], struct["name"]
        for field in struct["fields"]:
            place = getattr(kind, field["name"])
            assert (place.offset, place.size) == (field["offset"], field["size"]), f"{struct['name']}.{field['name']}"
        if struct["wire_name"]:
            assert kind.type_name() == struct["wire_name"]
