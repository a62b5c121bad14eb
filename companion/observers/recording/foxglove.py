"""Encodes Foxglove's messages as protobuf, and describes them, from one table and without a library.

JSON would carry a picture as base64, a third longer.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from typing import Any

NS = 1_000_000_000
"""Nanoseconds of a second."""

Field = tuple[str, int, str]
"""Name, number and type: of `_SCALARS`, or the name of a message or an enum below; "*" for a list of it."""

MESSAGES: Mapping[str, tuple[Field, ...]] = {
    "google.protobuf.Timestamp": (("seconds", 1, "int64"), ("nanos", 2, "int32")),
    "foxglove.Color": (("r", 1, "double"), ("g", 2, "double"), ("b", 3, "double"), ("a", 4, "double")),
    "foxglove.Point2": (("x", 1, "double"), ("y", 2, "double")),
    "foxglove.CompressedImage": (
        ("timestamp", 1, "google.protobuf.Timestamp"),
        ("data", 2, "bytes"),
        ("format", 3, "string"),
        ("frame_id", 4, "string"),
    ),
    "foxglove.PointsAnnotation": (
        ("timestamp", 1, "google.protobuf.Timestamp"),
        ("type", 2, "foxglove.PointsAnnotation.Type"),
        ("points", 3, "*foxglove.Point2"),
        ("outline_color", 4, "foxglove.Color"),
        ("thickness", 7, "double"),
    ),
    "foxglove.TextAnnotation": (
        ("timestamp", 1, "google.protobuf.Timestamp"),
        ("position", 2, "foxglove.Point2"),
        ("text", 3, "string"),
        ("font_size", 4, "double"),
        ("text_color", 5, "foxglove.Color"),
        ("background_color", 6, "foxglove.Color"),
    ),
    "foxglove.ImageAnnotations": (
        ("points", 2, "*foxglove.PointsAnnotation"),
        ("texts", 3, "*foxglove.TextAnnotation"),
        ("timestamp", 5, "google.protobuf.Timestamp"),
    ),
    "foxglove.Vector2": (("x", 1, "double"), ("y", 2, "double")),
    "foxglove.Vector3": (("x", 1, "double"), ("y", 2, "double"), ("z", 3, "double")),
    "foxglove.Quaternion": (("x", 1, "double"), ("y", 2, "double"), ("z", 3, "double"), ("w", 4, "double")),
    "foxglove.Pose": (("position", 1, "foxglove.Vector3"), ("orientation", 2, "foxglove.Quaternion")),
    "foxglove.PackedElementField": (
        ("name", 1, "string"),
        ("offset", 2, "fixed32"),
        ("type", 3, "foxglove.PackedElementField.NumericType"),
    ),
    "foxglove.Grid": (
        ("timestamp", 1, "google.protobuf.Timestamp"),
        ("frame_id", 2, "string"),
        ("pose", 3, "foxglove.Pose"),
        ("column_count", 4, "fixed32"),
        ("cell_size", 5, "foxglove.Vector2"),
        ("row_stride", 6, "fixed32"),
        ("cell_stride", 7, "fixed32"),
        ("fields", 8, "*foxglove.PackedElementField"),
        ("data", 9, "bytes"),
    ),
    "foxglove.LocationFix": (
        ("latitude", 1, "double"),
        ("longitude", 2, "double"),
        ("timestamp", 6, "google.protobuf.Timestamp"),
        ("frame_id", 7, "string"),
    ),
    "foxglove.Log": (
        ("timestamp", 1, "google.protobuf.Timestamp"),
        ("level", 2, "foxglove.Log.Level"),
        ("message", 3, "string"),
        ("name", 4, "string"),
    ),
    # What describes them: protobuf's own messages, as far as they are needed.
    "google.protobuf.FileDescriptorSet": (("file", 1, "*google.protobuf.FileDescriptorProto"),),
    "google.protobuf.FileDescriptorProto": (
        ("name", 1, "string"),
        ("package", 2, "string"),
        ("dependency", 3, "*string"),
        ("message_type", 4, "*google.protobuf.DescriptorProto"),
        ("syntax", 12, "string"),
    ),
    "google.protobuf.DescriptorProto": (
        ("name", 1, "string"),
        ("field", 2, "*google.protobuf.FieldDescriptorProto"),
        ("enum_type", 4, "*google.protobuf.EnumDescriptorProto"),
    ),
    "google.protobuf.FieldDescriptorProto": (
        ("name", 1, "string"),
        ("number", 3, "int32"),
        ("label", 4, "int32"),
        ("type", 5, "int32"),
        ("type_name", 6, "string"),
    ),
    "google.protobuf.EnumDescriptorProto": (
        ("name", 1, "string"),
        ("value", 2, "*google.protobuf.EnumValueDescriptorProto"),
    ),
    "google.protobuf.EnumValueDescriptorProto": (("name", 1, "string"), ("number", 2, "int32")),
}
ENUMS: Mapping[str, tuple[str, ...]] = {
    "foxglove.PointsAnnotation.Type": ("UNKNOWN", "POINTS", "LINE_LOOP", "LINE_STRIP", "LINE_LIST"),
    "foxglove.PackedElementField.NumericType": (
        *("UNKNOWN", "UINT8", "INT8", "UINT16", "INT16", "UINT32", "INT32", "FLOAT32", "FLOAT64"),
    ),
    "foxglove.Log.Level": ("UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL"),
}
_SCALARS = {"double": 1, "int64": 3, "int32": 5, "fixed32": 7, "string": 9, "bytes": 12}
"""Type -> its number in a descriptor."""
_WIDTHS = {1: 8, 5: 4}
"""Bytes of what is encoded in so many, by its wire type."""
_MESSAGE, _ENUM = 11, 14
_ONE, _LIST = 1, 3


def encode(name: str, content: Mapping[str, Any]) -> bytes:
    """Encode a message of `MESSAGES`. content: field -> value; a message is a mapping, a time is in ns.

    Fields that are not given are left out. Raises KeyError for one that there is not.
    """
    known = {field: (number, kind) for field, number, kind in MESSAGES[name]}
    return b"".join(
        _field(known[field][0], known[field][1].lstrip("*"), one)
        for field, value in content.items()
        for one in (value if known[field][1].startswith("*") else (value,))
    )


def jpeg_of(message: bytes) -> bytes:
    """Return the picture in a foxglove.CompressedImage. Raises ValueError for any other bytes."""
    for name, value in _fields("foxglove.CompressedImage", message):
        if name == "data":
            return value
    raise ValueError("a CompressedImage without a picture")


def outlines_of(message: bytes) -> list[list[tuple[float, float]]]:
    """Return the corners of each outline in foxglove.ImageAnnotations, in pixels. Raises ValueError."""
    found = []
    for name, outline in _fields("foxglove.ImageAnnotations", message):
        if name == "points":
            corners = [
                one for field, one in _fields("foxglove.PointsAnnotation", outline) if field == "points"
            ]
            found.append([_corner(one) for one in corners])
    return found


def _corner(message: bytes) -> tuple[float, float]:
    told = dict(_fields("foxglove.Point2", message))
    x, y = (struct.unpack("<d", told.get(name, bytes(8)))[0] for name in ("x", "y"))
    return x, y


def _fields(message: str, packed: bytes) -> Iterator[tuple[str, bytes]]:
    """Yield the fields of a message and the bytes of each; other numbers than bytes are left out.

    Raises ValueError.
    """
    names, at = {number: field for field, number, _ in MESSAGES[message]}, 0
    while at < len(packed):
        key, at = _read_varint(packed, at)
        kind = key & 7
        if kind == 0:
            _, at = _read_varint(packed, at)
            continue
        length, at = _read_varint(packed, at) if kind == 2 else (_WIDTHS.get(kind, len(packed) + 1), at)
        if at + length > len(packed):
            raise ValueError(f"no {message}, or one that is cut off")
        yield names.get(key >> 3, ""), packed[at : at + length]
        at += length


def descriptors(name: str) -> bytes:
    """Describe a message, and all that it consists of, as an encoded FileDescriptorSet."""
    files = [_file(one) for one in _needed(name)]
    return encode("google.protobuf.FileDescriptorSet", {"file": files})


def _field(number: int, kind: str, value: Any) -> bytes:
    if kind == "double":
        return _varint(number << 3 | 1) + struct.pack("<d", value)
    if kind == "fixed32":
        return _varint(number << 3 | 5) + struct.pack("<I", value)
    if kind in ("int32", "int64") or kind in ENUMS:
        return _varint(number << 3) + _varint(value)
    if kind == "google.protobuf.Timestamp" and isinstance(value, int):
        value = {"seconds": value // NS, "nanos": value % NS}
    if kind == "string":
        value = value.encode(errors="replace")  # a file's name may be no text
    packed = value if isinstance(value, bytes) else encode(kind, value)
    return b"".join((_varint(number << 3 | 2), _varint(len(packed)), packed))


def _varint(value: int) -> bytes:
    """Encode a number from 0."""
    found = bytearray()
    while value > 0x7F:
        found.append(value & 0x7F | 0x80)
        value >>= 7
    found.append(value)
    return bytes(found)


def _read_varint(packed: bytes, at: int) -> tuple[int, int]:
    """Return the number at `at`, and where it ends."""
    found = shift = 0
    while at < len(packed) and shift < 64:
        found |= (packed[at] & 0x7F) << shift
        shift, at = shift + 7, at + 1
        if packed[at - 1] < 0x80:
            return found, at
    raise ValueError("a number that does not end")


def _inner(name: str) -> list[str]:
    """List the messages that fields of this one hold, each once."""
    kinds = (kind.lstrip("*") for _, _, kind in MESSAGES[name])
    return list(dict.fromkeys(kind for kind in kinds if kind in MESSAGES))


def _needed(name: str) -> list[str]:
    """List a message and all that it consists of, each after those that it needs."""
    found = dict.fromkeys(one for inner in _inner(name) for one in _needed(inner))
    return [*found, name]


def _file(name: str) -> dict[str, Any]:
    package, _, short = name.rpartition(".")
    enums = [kind for kind in ENUMS if kind.startswith(f"{name}.")]
    return {
        "name": _path(name),
        "package": package,
        "dependency": [_path(one) for one in _inner(name)],
        "message_type": [
            {
                "name": short,
                "field": list(_described(name)),
                "enum_type": [{"name": kind.rpartition(".")[2], "value": _values(kind)} for kind in enums],
            }
        ],
        "syntax": "proto3",
    }


def _path(name: str) -> str:
    package, _, short = name.rpartition(".")
    return f"{package.replace('.', '/')}/{short.lower() if package == 'google.protobuf' else short}.proto"


def _described(name: str) -> Iterator[dict[str, Any]]:
    for field, number, kind in MESSAGES[name]:
        plain = kind.lstrip("*")
        described = {"name": field, "number": number, "label": _LIST if kind.startswith("*") else _ONE}
        if plain in _SCALARS:
            yield {**described, "type": _SCALARS[plain]}
        else:
            yield {**described, "type": _ENUM if plain in ENUMS else _MESSAGE, "type_name": f".{plain}"}


def _values(kind: str) -> list[dict[str, Any]]:
    return [{"name": value, "number": number} for number, value in enumerate(ENUMS[kind])]
