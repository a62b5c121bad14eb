"""What is encoded without a library is what protobuf's own reads, and what Foxglove describes."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("google.protobuf")

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from anytraverse.frame import Pose
from anytraverse.grid import CELL, SIDE
from anytraverse.grid_map import GridMap
from companion.observers.recording.contents import grid, image, image_annotations, location, log_line
from companion.observers.recording.foxglove import ENUMS, MESSAGES, NS, descriptors, encode
from tests.companion.observers.recording.made import SEEN

WHOLE = [name for name in MESSAGES if name.startswith("foxglove.")]


def reader(name: str) -> Any:
    """A message of protobuf's own library, made by our description alone."""
    files = descriptor_pb2.FileDescriptorSet.FromString(descriptors(name))
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(name))


def read(name: str, data: bytes) -> Any:
    return reader(name).FromString(data)


@pytest.mark.parametrize("name", WHOLE)
def test_a_description_is_whole_and_names_each_field(name: str) -> None:
    described = reader(name).DESCRIPTOR
    assert [(field.name, field.number) for field in described.fields] == [one[:2] for one in MESSAGES[name]]
    for enum in described.enum_types:
        assert tuple(value.name for value in enum.values) == ENUMS[f"{name}.{enum.name}"]


@pytest.mark.parametrize("name", WHOLE)
def test_fields_are_those_of_foxgloves_own_schemas(name: str) -> None:
    pytest.importorskip("foxglove_schemas_protobuf", reason="foxglove-schemas-protobuf is not installed")
    short = name.rpartition(".")[2]
    theirs = getattr(importlib.import_module(f"foxglove_schemas_protobuf.{short}_pb2"), short).DESCRIPTOR
    for field in reader(name).DESCRIPTOR.fields:
        other = theirs.fields_by_name[field.name]
        assert (field.number, field.type, field.is_repeated) == (other.number, other.type, other.is_repeated)
        if field.enum_type is not None:
            assert field.enum_type.values_by_name.keys() == other.enum_type.values_by_name.keys()


@given(st.integers(0, 4 * 10**18), st.binary(max_size=300), st.text(max_size=40))
def test_protobuf_reads_what_was_encoded(at: int, data: bytes, text: str) -> None:
    found = read("foxglove.CompressedImage", image(data, text, at))
    assert (found.timestamp.seconds, found.timestamp.nanos) == divmod(at, NS)
    assert (found.data, found.format, found.frame_id) == (data, text, "camera")


@given(st.floats(-90, 90), st.floats(-180, 180), st.integers(0, 60), st.text(max_size=200))
def test_numbers_and_texts_survive(latitude: float, longitude: float, level: int, text: str) -> None:
    found = read("foxglove.LocationFix", location(latitude, longitude, 5))
    assert (found.latitude, found.longitude, found.timestamp.nanos) == (latitude, longitude, 5)
    line = read("foxglove.Log", log_line(level, "a.name", text, NS))
    assert (line.name, line.message, line.timestamp.seconds) == ("a.name", text, 1)
    assert line.level == {5: 5, 4: 4, 3: 3, 2: 2}.get(level // 10, 5 if level >= 50 else 1)


@given(
    left=st.integers(0, 199),
    top=st.integers(0, 199),
    wide=st.integers(1, 200),
    corner=st.tuples(st.integers(-(10**6), 10**6), st.integers(-(10**6), 10**6)),
)
def test_a_grid_is_the_known_cells_where_they_are_by_odometry(
    left: int, top: int, wide: int, corner: tuple[int, int]
) -> None:
    share = np.full((SIDE, SIDE), 255, np.uint8)
    share[top : top + wide, left : left + wide] = 7
    uncertainty = np.where(share == 7, 9, 255).astype(np.uint8)
    told = GridMap(1.0, Pose(0.0, 0.0, 0.0), corner, share.tobytes(), uncertainty.tobytes())
    found = read("foxglove.Grid", grid(told, 3 * NS))
    columns, rows = min(wide, SIDE - left), min(wide, SIDE - top)
    assert (found.column_count, found.row_stride, found.cell_stride) == (columns, 2 * columns, 2)
    assert found.data == bytes([7, 9]) * (columns * rows)
    assert [(one.name, one.offset, one.type) for one in found.fields] == [
        ("drivable", 0, 1),
        ("uncertainty", 1, 1),
    ]
    place = found.pose.position
    assert (place.x, place.y) == pytest.approx(((corner[0] + left) * CELL, (corner[1] + top) * CELL))
    assert found.pose.orientation.w == found.timestamp.seconds / 3 == 1.0


def test_a_grid_that_knows_nothing_is_one_unknown_cell() -> None:
    cells = bytes([255]) * (SIDE * SIDE)
    found = read("foxglove.Grid", grid(GridMap(1.0, Pose(0.0, 0.0, 0.0), (0, 0), cells, cells), 0))
    assert (found.column_count, found.data) == (1, bytes([255, 255]))


def test_boxes_are_closed_lines_in_pixels() -> None:
    region = SEEN.tile
    assert region is not None
    found = read("foxglove.ImageAnnotations", image_annotations(SEEN, region.box, "7 CALLING", 3 * NS))
    height, width = SEEN.frame.image.shape[:2]
    assert [line.type for line in found.points] == [2, 2]
    for line in found.points:
        assert len(line.points) == 4
        assert all(0 <= point.x <= width and 0 <= point.y <= height for point in line.points)
        assert line.timestamp.seconds == 3
    assert [text.text for text in found.texts] == ["7 CALLING"]


def test_a_field_that_there_is_not_is_an_error() -> None:
    with pytest.raises(KeyError):
        encode("foxglove.Log", {"lvl": 1})


def test_a_file_name_that_is_no_text_is_logged_with_question_marks() -> None:
    assert read("foxglove.Log", log_line(20, "a", "caf\udce9.jpg", NS)).message == "caf?.jpg"
