"""`omnilab.proto` says what the logs hold."""

import re
from pathlib import Path

from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.reader import make_reader

PROTO = Path(__file__).parents[1] / "omnilab.proto"
TYPES = {
    FieldDescriptor.TYPE_DOUBLE: "double",
    FieldDescriptor.TYPE_INT64: "int64",
    FieldDescriptor.TYPE_STRING: "string",
}


def documented():
    """Of the documentation: package, imports, and by message its (type, name, number)."""
    text = re.sub(r"//.*", "", PROTO.read_text())
    messages = {
        name: [(kind, label, int(number)) for kind, label, number in re.findall(r"([\w.]+) (\w+) = (\d+);", body)]
        for name, body in re.findall(r"message (\w+) {(.*?)}", text, re.DOTALL)
    }
    return re.findall(r"package (\w+);", text), re.findall(r'import "(.*)";', text), messages


def test_documentation_equals_the_embedded_schemas(run):
    with (run / "run.mcap").open("rb") as file:
        schemas = make_reader(file).get_summary().schemas.values()
    embedded = {schema.name: FileDescriptorSet.FromString(schema.data) for schema in schemas}
    package, imports, messages = documented()
    assert {name for name in embedded if name.startswith("omnilab.")} == {f"{package[0]}.{name}" for name in messages}
    for name in messages:
        (file,) = [file for file in embedded[f"omnilab.{name}"].file if file.package == "omnilab"]
        assert sorted(file.dependency) == sorted(imports)
        assert file.syntax == "proto3"
        assert messages == {
            message.name: [
                (TYPES.get(field.type, field.type_name.lstrip(".")), field.name, field.number)
                for field in message.field
            ]
            for message in file.message_type
        }


def test_embedded_schemas_bring_all_they_need(run):
    with (run / "run.mcap").open("rb") as file:
        schemas = make_reader(file).get_summary().schemas.values()
    for schema in schemas:
        files = FileDescriptorSet.FromString(schema.data).file
        assert {name for file in files for name in file.dependency} <= {file.name for file in files}
