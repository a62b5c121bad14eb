"""RELLIS-3D, RUGD, DeepScene and YCOR: small trees of their layout, with known scores; whole, and wrong."""

from __future__ import annotations

import json
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anytraverse.cli import main
from anytraverse.evaluation.datasets import KINDS, Selection, kind_and_path, open_dataset
from anytraverse.evaluation.datasets.rellis import _pair
from anytraverse.evaluation.datasets.rugd import CODE
from anytraverse.evaluation.labels import DatasetError
from tests.anytraverse.evaluation.trees import TREES, blocks, write

Out = pytest.CaptureFixture[str]

DRIVABLE = {"rellis": "grass", "rugd": "grass", "deepscene": "grass", "ycor": "traversable_grass"}
TEST = {"rellis": "test", "rugd": "test", "deepscene": "test", "ycor": "valid"}
PUBLISHED = sorted(TREES)


@pytest.fixture(params=PUBLISHED)
def tree(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[str, Path]:
    """Kind and folder of each."""
    kind: str = request.param
    return kind, TREES[kind](tmp_path / kind)


def frames(name: str, split: str = "all") -> list[Any]:
    def torn(what: str) -> None:
        raise AssertionError(what)

    return list(open_dataset(name, split).frames(torn))


@pytest.mark.usefixtures("grey")
def test_each_is_scored_as_its_labels_say(tree: tuple[str, Path], capsys: Out) -> None:
    kind, root = tree
    command = ["score", f"{kind}:{root}", "--perceiver", "grey", "--prompts", "grass: 1; bush: -1"]
    assert main([*command, "--drivable", DRIVABLE[kind], "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["images"] == 2
    assert figures["iou_pooled"] == pytest.approx(3 / 4, abs=0.03)
    assert figures["iou_mean"] == pytest.approx((1 + 1 / 2) / 2, abs=0.03)
    assert figures["words"]["grass"]["pixels"] in {3 * 1024, 3 * 256}


def test_splits_are_those_that_were_published(tree: tuple[str, Path]) -> None:
    kind, root = tree
    (held_out,) = frames(f"{kind}:{root}", TEST[kind])
    (training,) = frames(f"{kind}:{root}", "train")
    classes = open_dataset(f"{kind}:{root}").classes
    assert not classes.labelled(held_out.labels)[:, -8:].any()
    assert classes.labelled(training.labels).all()
    assert {training.name, held_out.name} == {frame.name for frame in frames(f"{kind}:{root}")}
    with pytest.raises(DatasetError, match=r'has no split "holdout": choose from all, train'):
        open_dataset(f"{kind}:{root}", "holdout")


def test_frames_are_chosen_by_their_place(tree: tuple[str, Path]) -> None:
    kind, root = tree
    chosen = open_dataset(f"{kind}:{root}", selection=Selection(first=1))
    assert chosen.numbers == (1,)
    assert chosen.name(1) == frames(f"{kind}:{root}")[1].name


def test_a_missing_picture_is_named_with_where_to_get_it(tree: tuple[str, Path]) -> None:
    kind, root = tree
    picture = open_dataset(f"{kind}:{root}").files[0].picture
    picture.unlink()
    with pytest.raises(DatasetError, match=r"has no picture.*get .* from http.*\(.*\)") as refused:
        open_dataset(f"{kind}:{root}")
    assert picture.name in str(refused.value)


def test_a_folder_that_is_missing_is_named_with_what_to_unpack(tmp_path: Path) -> None:
    for kind in PUBLISHED:
        with pytest.raises(DatasetError, match=r"is missing: it comes with .*; get .* from http"):
            open_dataset(f"{kind}:{tmp_path / 'absent'}")
    (tmp_path / "empty").mkdir()
    for kind in PUBLISHED:
        with pytest.raises(DatasetError, match=r"get .* from http"):
            open_dataset(f"{kind}:{tmp_path / 'empty'}")


def test_a_list_that_is_missing_or_no_list_is_named(tmp_path: Path) -> None:
    root = TREES["rellis"](tmp_path)
    with pytest.raises(DatasetError, match=r'val\.lst is missing: unpack "Image Split File" there'):
        open_dataset(f"rellis:{root}", "val")
    for content in (b"", b"\n \n", b"\xff\xfe"):
        (root / "val.lst").write_bytes(content)
        with pytest.raises(DatasetError, match=r"val\.lst lists no pictures"):
            open_dataset(f"rellis:{root}", "val")


@pytest.mark.parametrize(
    "line",
    [
        "/etc/a/b.jpg",
        "00000/../../secret/x.jpg 00000/a/b.png",
        "frame.jpg frame.png",
        "a/b/c.jpg a/b/c.png more",
    ],
)
def test_a_line_that_leaves_the_data_set_or_is_none_is_refused(line: str) -> None:
    with pytest.raises(DatasetError, match="is no line of a split"):
        _pair(Path("root"), line)


@given(st.text().filter(str.strip))
def test_any_line_gives_files_of_the_data_set_or_is_refused(line: str) -> None:
    try:
        pair = _pair(Path("root"), line)
    except DatasetError:
        return
    for file in pair:
        assert ".." not in file.parts
        assert file.parts[0] == "root"


def test_lists_are_found_in_a_folder_of_their_own(tmp_path: Path) -> None:
    root = TREES["rellis"](tmp_path)
    (root / "Rellis_3D_image_split").mkdir()
    (root / "train.lst").rename(root / "Rellis_3D_image_split" / "train.lst")
    assert len(open_dataset(f"rellis:{root}", "train")) == 1


def test_ids_that_the_benchmarks_merge_are_merged_and_others_are_refused(tmp_path: Path) -> None:
    root = TREES["rellis"](tmp_path)
    one = open_dataset(f"rellis:{root}", "train")
    file = one.files[0].label
    write(file, blocks([29, 30, 3, 32]))
    (frame,) = frames(f"rellis:{root}", "train")
    assert one.classes.mask(frame.labels, ["grass"]).sum() == 3 * 1024
    assert one.classes.mask(frame.labels, ["water"]).sum() == 1024
    write(file, blocks([3, 3, 3, 2]))
    with pytest.raises(DatasetError, match="holds the id 2, which RELLIS-3D does not name"):
        frames(f"rellis:{root}", "train")


def test_colours_of_another_data_set_are_refused_and_a_few_stray_ones_are_not_labelled(
    tmp_path: Path,
) -> None:
    root = TREES["rugd"](tmp_path)
    label = root / "RUGD_annotations" / "trail-3" / "trail-3_00001.png"
    stray = blocks([(0, 102, 0)] * 4)
    stray[0, :40] = (1, 2, 3)
    write(label, stray)
    (frame,) = frames(f"rugd:{root}", "train")
    assert (frame.labels == 255).sum() == 40
    stray[1, :40] = (1, 2, 3)
    write(label, stray)
    with pytest.raises(DatasetError, match=r"2% of it has colours of no class of RUGD, mostly \(1, 2, 3\)"):
        frames(f"rugd:{root}", "all")


def test_every_colour_is_read_as_its_class() -> None:
    names = list(CODE.classes.names)
    row = np.array([[(20, 64, 108), (47, 85, 114), (0, 0, 0)]], dtype=np.uint8)
    found = CODE.ids(row, Path("row.png")).tolist()[0]
    assert [names[found[0]], names[found[1]], found[2]] == ["dirt", "picnic-table", 255]
    assert len(names) == 24


def test_a_palette_is_read_by_its_colours(tmp_path: Path) -> None:
    root = TREES["ycor"](tmp_path)
    label = root / "yamaha_v0" / "train" / "iid000000" / "labels.png"
    label.write_bytes(_palette_png(128, 32, {7: (128, 255, 0)}, 7))
    (frame,) = frames(f"ycor:{root}", "train")
    classes = open_dataset(f"ycor:{root}").classes
    assert classes.mask(frame.labels, ["traversable grass"]).all()


def _palette_png(width: int, height: int, palette: dict[int, tuple[int, int, int]], value: int) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    colours = b"".join(bytes(palette.get(number, (0, 0, 0))) for number in range(9))
    rows = (b"\0" + bytes([value]) * width) * height
    header = struct.pack(">IIBBBBB", width, height, 8, 3, 0, 0, 0)
    parts = (b"IHDR", header), (b"PLTE", colours), (b"IDAT", zlib.compress(rows)), (b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*part) for part in parts)


def test_pictures_and_labels_of_another_shape_are_refused(tmp_path: Path) -> None:
    root = TREES["deepscene"](tmp_path)
    label = root / "freiburg_forest_annotated" / "test" / "GT_color" / "b1-1_mask.png"
    write(label, blocks([(0, 255, 0)] * 4)[:16, :40])
    with pytest.raises(DatasetError, match=r"is 40x16 and b1-1_Clipped.jpg is 128x32"):
        frames(f"deepscene:{root}", "test")


def test_kinds_are_named_before_a_colon(tmp_path: Path) -> None:
    assert kind_and_path("rugd:data/x") == ("rugd", Path("data/x"))
    assert kind_and_path("drive") == ("folder", Path("drive"))
    (tmp_path / "mon:day").mkdir()
    assert kind_and_path(str(tmp_path / "mon:day"))[0] == "folder"
    for name in ("kitti:DIR", "rugd:"):
        with pytest.raises(DatasetError, match="is no data set: write one of folder:DIR, rellis:DIR"):
            kind_and_path(name)
    with pytest.raises(DatasetError, match="choose frames with --from and --to"):
        open_dataset("drive", "test")
    assert {*PUBLISHED, "folder"} == set(KINDS)
