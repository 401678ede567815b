"""The messages that Foxglove has no schema for. `omnilab.proto` documents what is built here."""

from __future__ import annotations

from typing import Any

from foxglove_schemas_protobuf import Vector3_pb2
from google.protobuf import (  # type: ignore[import-untyped]
    descriptor_pb2,
    descriptor_pool,
    message_factory,
    timestamp_pb2,
)

TIMESTAMP = timestamp_pb2.Timestamp.DESCRIPTOR
VECTOR3 = Vector3_pb2.Vector3.DESCRIPTOR
Field = descriptor_pb2.FieldDescriptorProto
MESSAGES = {
    "Scalar": {
        "timestamp": TIMESTAMP,
        "step": Field.TYPE_INT64,
        "value": Field.TYPE_DOUBLE,
        "unit": Field.TYPE_STRING,
    },
    "Estimate": {
        "timestamp": TIMESTAMP,
        "step": Field.TYPE_INT64,
        "truth_m": VECTOR3,
        "answer_m": VECTOR3,
        "verdict": Field.TYPE_STRING,
        "truth_heading_rad": Field.TYPE_DOUBLE,
        "answer_heading_rad": Field.TYPE_DOUBLE,
    },
}


def _classes() -> tuple[Any, ...]:
    file = descriptor_pb2.FileDescriptorProto(name="omnilab/omnilab.proto", package="omnilab", syntax="proto3")
    file.dependency.extend([TIMESTAMP.file.name, VECTOR3.file.name])
    for name, fields in MESSAGES.items():
        message = file.message_type.add(name=name)
        for number, (label, kind) in enumerate(fields.items(), start=1):
            field = message.field.add(name=label, number=number, label=Field.LABEL_OPTIONAL)
            if isinstance(kind, int):
                field.type = kind
            else:
                field.type, field.type_name = Field.TYPE_MESSAGE, f".{kind.full_name}"
    pool = descriptor_pool.Default()
    pool.Add(file)
    return tuple(message_factory.GetMessageClass(pool.FindMessageTypeByName(f"omnilab.{name}")) for name in MESSAGES)


Scalar, Estimate = _classes()
