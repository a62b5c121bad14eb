"""A bundle appears whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from anytraverse.bundle.manifest import MANIFEST, read_manifest, verify
from anytraverse.bundle.writing import BundleWriter
from anytraverse.errors import BundleError
from anytraverse.perception import DefaultThresholds
from anytraverse.perception.resizing import Fit

MakeBundle = Callable[..., Path]


def finish(writer: BundleWriter, name: str = "new", content: bytes = b"new", kind: str = "sham") -> None:
    """Write a bundle of one file."""
    (writer.folder / "a.onnx").write_bytes(content)
    writer.finish(
        kind=kind,
        name=name,
        model_id="sham-2",
        image=Fit(32, 32),
        scene="shared",
        thresholds=DefaultThresholds(roi=0.3, scene=0.9),
        variants={"fp32": {"image": "a.onnx"}},
        source={},
    )


def test_a_written_bundle_verifies_and_lies_alone(make_bundle: MakeBundle, tmp_path: Path) -> None:
    folder = make_bundle()
    verify(folder, read_manifest(folder))
    assert list(tmp_path.iterdir()) == [folder]


def test_parents_are_made(tmp_path: Path) -> None:
    with BundleWriter(tmp_path / "a" / "b") as writer:
        finish(writer)
    assert read_manifest(tmp_path / "a" / "b").name == "new"


def test_others_may_read_what_the_writer_wrote(make_bundle: MakeBundle) -> None:
    umask = os.umask(0o022)
    try:
        folder = make_bundle()
    finally:
        os.umask(umask)
    assert folder.stat().st_mode & 0o777 == 0o755


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, SystemExit])
def test_an_error_or_ctrl_c_leaves_nothing(tmp_path: Path, error: type[BaseException]) -> None:
    def fail(writer: BundleWriter) -> None:
        (writer.folder / "a.onnx").write_bytes(b"half")
        raise error

    with pytest.raises(error), BundleWriter(tmp_path / "bundle") as writer:
        fail(writer)
    assert list(tmp_path.iterdir()) == []


def test_a_writer_that_never_finishes_leaves_nothing(tmp_path: Path) -> None:
    with BundleWriter(tmp_path / "bundle") as writer:
        (writer.folder / "a.onnx").write_bytes(b"half")
    assert list(tmp_path.iterdir()) == []


def test_what_reading_would_refuse_is_not_put_in_place(make_bundle: MakeBundle, tmp_path: Path) -> None:
    folder = make_bundle()
    with pytest.raises(BundleError, match="name is"), BundleWriter(folder) as writer:
        finish(writer, name="two\nlines")
    assert read_manifest(folder).name == "a sham"
    assert list(tmp_path.iterdir()) == [folder]


def test_an_older_bundle_and_its_records_are_replaced(make_bundle: MakeBundle, tmp_path: Path) -> None:
    folder = make_bundle()
    (folder / "checks").mkdir()
    (folder / "checks" / "a-machine.json").write_text("{}")
    with BundleWriter(folder) as writer:
        finish(writer)
        assert read_manifest(folder).name == "new"
    assert sorted(path.name for path in folder.iterdir()) == ["a.onnx", MANIFEST]
    assert list(tmp_path.iterdir()) == [folder]


def test_a_failing_replacement_leaves_the_older_bundle(
    make_bundle: MakeBundle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = make_bundle()
    rename = Path.rename

    def fail_for_the_new_one(path: Path, target: Path) -> Path:
        if path.name.endswith(".part"):
            raise KeyboardInterrupt
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", fail_for_the_new_one)
    with pytest.raises(KeyboardInterrupt), BundleWriter(folder) as writer:
        finish(writer)
    assert read_manifest(folder).name == "a sham"
    assert list(tmp_path.iterdir()) == [folder]


def test_an_empty_folder_is_used(tmp_path: Path) -> None:
    (tmp_path / "bundle").mkdir()
    with BundleWriter(tmp_path / "bundle") as writer:
        finish(writer)
    assert read_manifest(tmp_path / "bundle").name == "new"


@pytest.mark.parametrize("manifest", [None, "{}", '{"manifest_version": 3}', "torn"])
def test_a_folder_that_is_no_bundle_is_left_alone(tmp_path: Path, manifest: str | None) -> None:
    home = tmp_path / "home"
    home.mkdir()
    (home / "thesis.txt").write_text("mine")
    if manifest is not None:
        (home / MANIFEST).write_text(manifest)
    with pytest.raises(BundleError, match="not a bundle"), BundleWriter(home):
        raise AssertionError
    assert (home / "thesis.txt").read_text() == "mine"
    assert list(tmp_path.iterdir()) == [home]


def test_a_bundle_with_files_that_are_not_its_own_is_left_alone(make_bundle: MakeBundle) -> None:
    folder = make_bundle()
    (folder / "notes.txt").write_text("mine")
    with pytest.raises(BundleError, match=r"not its own \(notes.txt\)"), BundleWriter(folder):
        raise AssertionError


def test_a_file_in_the_place_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "bundle").write_text("mine")
    with pytest.raises(BundleError, match="is a file"), BundleWriter(tmp_path / "bundle"):
        raise AssertionError


def test_what_came_to_lie_there_meanwhile_is_left_alone(tmp_path: Path) -> None:
    with BundleWriter(tmp_path / "bundle") as writer:
        (tmp_path / "bundle").mkdir()
        (tmp_path / "bundle" / "thesis.txt").write_text("mine")
        with pytest.raises(BundleError, match="not a bundle"):
            finish(writer)
    assert [path.name for path in tmp_path.rglob("*")] == ["bundle", "thesis.txt"]


def test_a_link_does_not_get_into_a_bundle(tmp_path: Path) -> None:
    with BundleWriter(tmp_path / "b") as writer:
        (writer.folder / "b.onnx").symlink_to("/etc/hostname")
        with pytest.raises(BundleError, match="neither a file nor a folder"):
            finish(writer)


def test_a_bundle_behind_a_link_is_replaced_where_it_lies(make_bundle: MakeBundle, tmp_path: Path) -> None:
    folder = make_bundle()
    (tmp_path / "current").symlink_to(folder)
    with BundleWriter(tmp_path / "current") as writer:
        finish(writer)
    assert (tmp_path / "current").is_symlink()
    assert read_manifest(folder).name == "new"


def test_what_a_killed_one_left_is_named(tmp_path: Path) -> None:
    left = tmp_path / ".new[1].abcdefgh.part"
    left.mkdir()
    told: list[str] = []
    with BundleWriter(tmp_path / "new[1]", told.append) as writer:
        finish(writer)
    assert told[0].endswith(f"rm -r {left}")
    assert left.is_dir()


def test_a_bundle_of_another_kind_is_not_replaced(make_bundle: MakeBundle) -> None:
    """Hundreds of megabytes would be gone for a wrong name."""
    folder = make_bundle()
    before = read_manifest(folder)
    refusal = pytest.raises(BundleError, match='of kind "sham", and the new one would be "other"')
    with BundleWriter(folder) as writer, refusal:
        finish(writer, kind="other")
    assert read_manifest(folder) == before
