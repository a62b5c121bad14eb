"""A manifest is read whole and sound, or refused with what to do."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.bundle.manifest import FORMAT, MANIFEST, Manifest, manifest_digest, read_manifest, verify
from anytraverse.errors import BundleError

MakeBundle = Callable[..., Path]


@pytest.fixture
def folder(make_bundle: MakeBundle) -> Path:
    """A sound bundle."""
    return make_bundle()


def edited(folder: Path, edit: Callable[[dict[str, Any]], Any]) -> Path:
    """The bundle with its manifest changed."""
    values = json.loads((folder / MANIFEST).read_text())
    edit(values)
    (folder / MANIFEST).write_text(json.dumps(values))
    return folder


def test_what_was_written_is_read(folder: Path) -> None:
    manifest = read_manifest(folder, "sham")
    assert manifest.model_id == "sham-1"
    assert (manifest.image.width, manifest.image.filter) == (64, "bilinear")
    assert (manifest.thresholds.tile, manifest.thresholds.tile_share) == (None, 0.25)
    assert manifest.scene_image is None
    assert manifest.source["licence"] == "none"
    assert set(manifest.files) == {"image.onnx", "image.int8.onnx", "text/tokens.json"}


def test_a_part_that_a_variant_lacks_is_taken_from_fp32(folder: Path) -> None:
    manifest = read_manifest(folder)
    assert manifest.file("int8", "image") == "image.int8.onnx"
    assert manifest.file("int8", "tokenizer") == "text/tokens.json"
    assert manifest.needed("int8") == ["image.int8.onnx", "text/tokens.json"]


def test_a_variant_or_part_that_is_not_there_is_named(folder: Path) -> None:
    manifest = read_manifest(folder)
    with pytest.raises(BundleError, match="--precision fp32,fp16"):
        manifest.file("fp16", "image")
    with pytest.raises(BundleError, match='no part "decoder"'):
        manifest.file("fp32", "decoder")


def test_a_newer_format_asks_for_a_newer_program(folder: Path) -> None:
    def newer(values: dict[str, Any]) -> None:
        values["format"] = FORMAT + 1
        values["something new"] = 1

    with pytest.raises(BundleError, match="update this program"):
        read_manifest(edited(folder, newer))


def test_a_bundle_of_another_kind_says_how_to_use_it(folder: Path) -> None:
    with pytest.raises(BundleError, match=f'of kind "sham", not "clipseg".*sham:{folder}'):
        read_manifest(folder, "clipseg")


@pytest.mark.parametrize("missing", ["a folder", "nothing at all"])
def test_a_folder_that_is_no_bundle_is_said_to_be_none(tmp_path: Path, missing: str) -> None:
    path = tmp_path / missing
    if missing == "a folder":
        path.mkdir()
    with pytest.raises(BundleError, match=r"is not a bundle.*anytraverse export"):
        read_manifest(path)


def test_a_missing_file_asks_for_a_whole_copy(folder: Path) -> None:
    (folder / "image.onnx").unlink()
    with pytest.raises(BundleError, match=r"image\.onnx is missing: copy the bundle again"):
        read_manifest(folder)


@pytest.mark.parametrize("content", [b"", b"weights", b"weights" * 101])
def test_a_file_of_another_size_is_torn(folder: Path, content: bytes) -> None:
    (folder / "image.onnx").write_bytes(content)
    with pytest.raises(BundleError, match=f"torn: {len(content)} bytes, expected 700 bytes"):
        read_manifest(folder)


def test_a_folder_in_the_place_of_a_file_is_torn(folder: Path) -> None:
    (folder / "image.onnx").unlink()
    (folder / "image.onnx").mkdir()
    with pytest.raises(BundleError, match="torn: no file"):
        read_manifest(folder)


def test_a_flipped_byte_is_found_by_verifying_and_not_before(folder: Path) -> None:
    (folder / "image.onnx").write_bytes(b"weightz" + b"weights" * 99)
    manifest = read_manifest(folder)
    said: list[str] = []
    with pytest.raises(BundleError, match=r"image\.onnx is torn: its SHA-256"):
        verify(folder, manifest, said.append)
    assert [line.split()[0] for line in said] == ["image.int8.onnx"]


def test_a_variant_is_verified_without_the_files_of_another(folder: Path) -> None:
    (folder / "image.onnx").write_bytes(b"weightz" + b"weights" * 99)
    verify(folder, read_manifest(folder), precision="int8")


def test_other_files_in_the_folder_do_not_matter(folder: Path) -> None:
    (folder / "notes.txt").write_text("mine")
    said: list[str] = []
    verify(folder, read_manifest(folder), said.append)
    assert len(said) == 3


@pytest.mark.parametrize(
    "name",
    ["../image.onnx", "/etc/passwd", "a/../../b", "a\\b", ".hidden", "", "a//b", "a/", "\x00", MANIFEST],
)
def test_a_name_that_leaves_the_folder_is_refused(folder: Path, name: str) -> None:
    def escape(values: dict[str, Any]) -> None:
        values["files"][name] = values["files"]["image.onnx"]

    with pytest.raises(BundleError, match="inside the folder"):
        read_manifest(edited(folder, escape))


def test_a_link_that_leaves_the_folder_is_refused(folder: Path, tmp_path: Path) -> None:
    outside = tmp_path / "elsewhere.onnx"
    outside.write_bytes((folder / "image.onnx").read_bytes())
    (folder / "image.onnx").unlink()
    (folder / "image.onnx").symlink_to(outside)
    with pytest.raises(BundleError, match="leads out of the bundle"):
        read_manifest(folder)


def test_a_bundle_reached_by_a_link_is_read(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "current").symlink_to(folder)
    assert read_manifest(tmp_path / "current").kind == "sham"


@pytest.mark.parametrize(
    ("path", "value", "told"),
    [
        (("image", "width"), 0, "width is 0, expected a whole number from 1 to 4096"),
        (("image", "width"), True, "width is true, expected a whole number"),
        (("image", "filter"), "lanczos", 'filter is "lanczos", expected one of bilinear, bicubic'),
        (("image", "crop"), 0, "crop is 0, expected true or false"),
        (("scene",), "other", 'scene is "other", expected one of'),
        (("scene",), "clip-b32", "scene_image is null, expected the input"),
        (("thresholds", "roi"), "high", 'roi is "high", expected a number'),
        (("thresholds", "tile_share"), 0, "tile_share is 0, expected a number from"),
        (("thresholds", "scene"), -2, "scene is -2, expected a number from -1 to 1"),
        (("variants",), {"int8": {}}, "fp32 is missing"),
        (("variants", "fp32", "image"), "absent.onnx", 'image is "absent.onnx", expected one of'),
        (("model_id",), "", 'model_id is "", expected one line of text'),
        (("name",), "two\nlines", "expected one line of text"),
        (("files", "image.onnx", "sha256"), "0" * 63, "expected 64 hexadecimal digits"),
        (("files", "image.onnx", "size"), -1, "size is -1, expected a whole number from 0"),
        (("source",), [], r"source is \[\], expected an object"),
        (("normalise",), True, "an unknown field"),
    ],
)
def test_an_unfit_field_is_named_with_what_came_and_what_was_expected(
    folder: Path, path: tuple[str, ...], value: Any, told: str
) -> None:
    def replace(values: dict[str, Any]) -> None:
        for name in path[:-1]:
            values = values[name]
        values[path[-1]] = value

    with pytest.raises(BundleError, match=told):
        read_manifest(edited(folder, replace))


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"{",
        b"[]",
        b"null",
        b"\xff\xfe{}",
        b'{"format": NaN}',
        b'{"format": 1e999}',
        b'{"name": "\\ud800"}',
        b"[" * 100_000,
        b'{"format": ' + b"9" * 5000 + b"}",
    ],
)
def test_what_is_no_manifest_is_refused(folder: Path, data: bytes) -> None:
    (folder / MANIFEST).write_bytes(data)
    with pytest.raises(BundleError):
        read_manifest(folder)


def test_the_digest_changes_with_the_manifest(folder: Path) -> None:
    before = manifest_digest(folder)
    assert manifest_digest(edited(folder, lambda values: values.update(name="other"))) != before


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=5,
)


def read(folder: Path) -> Manifest | BundleError:
    """The manifest, or its refusal."""
    try:
        return read_manifest(folder)
    except BundleError as error:
        return error


def nodes(value: Any) -> list[tuple[dict[str, Any], str]]:
    """Every field of every object in it."""
    if not isinstance(value, dict):
        return []
    return [(value, name) for name in value] + [node for inner in value.values() for node in nodes(inner)]


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Callable[[], tuple[Path, bytes]]:
    """A bundle that examples spoil, and the manifest it has when sound."""
    files = {"a.onnx": b"a" * 10}
    folder = tmp_path_factory.mktemp("mutated")
    digest = "0" * 64
    (folder / "a.onnx").write_bytes(files["a.onnx"])
    fit = {"width": 32, "height": 32, "filter": "bilinear", "crop": False}
    values = {
        "format": FORMAT,
        "kind": "sham",
        "name": "a sham",
        "model_id": "sham-1",
        "image": fit,
        "scene": "clip-b32",
        "scene_image": {**fit, "crop": True},
        "thresholds": {"roi": 0.3, "scene": 0.9, "tile": 0.5},
        "variants": {"fp32": {"image": "a.onnx"}},
        "details": {"names": ["a"]},
        "source": {"weights": "none"},
        "files": {"a.onnx": {"size": 10, "sha256": digest}},
    }
    return lambda: (folder, json.dumps(values).encode())


@pytest.mark.slow
@settings(max_examples=300)
@given(st.data())
def test_whatever_becomes_of_a_manifest_it_is_read_or_refused(
    sound: Callable[[], tuple[Path, bytes]], data: st.DataObject
) -> None:
    folder, text = sound()
    values = json.loads(text)
    for _ in range(data.draw(st.integers(1, 2))):
        parent, name = data.draw(st.sampled_from(nodes(values)))
        deed = data.draw(st.sampled_from(["replace", "remove", "add"]))
        if deed == "remove":
            del parent[name]
        else:
            parent[name if deed == "replace" else data.draw(st.text(max_size=8))] = data.draw(JSON)
    (folder / MANIFEST).write_text(json.dumps(values), encoding="utf-8")
    outcome = read(folder)
    if isinstance(outcome, BundleError):
        assert str(folder) in str(outcome)
    else:
        assert 0 < outcome.thresholds.roi <= 1
        assert set(outcome.parts("fp32").values()) <= set(outcome.files) <= {"a.onnx"}


@settings(max_examples=200)
@given(st.integers(0, 10_000), st.binary(max_size=3))
def test_bytes_damaged_anywhere_are_read_or_refused(
    sound: Callable[[], tuple[Path, bytes]], place: int, damage: bytes
) -> None:
    folder, text = sound()
    place %= len(text)
    (folder / MANIFEST).write_bytes(text[:place] + damage + text[place + 1 :])
    outcome = read(folder)
    assert isinstance(outcome, Manifest) or str(folder) in str(outcome)


def test_a_copied_bundle_is_the_same_bundle(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "copy")
    assert read_manifest(tmp_path / "copy") == read_manifest(folder)
    assert manifest_digest(tmp_path / "copy") == manifest_digest(folder)
