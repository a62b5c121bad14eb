"""Writes a bundle atomically: all of it appears at once, or nothing."""

from __future__ import annotations

import glob
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import Any

from anytraverse.bundle.fields import parse_object
from anytraverse.bundle.files import sha256_of
from anytraverse.bundle.manifest import FORMAT, LARGEST_MANIFEST, MANIFEST, Manifest, read_manifest
from anytraverse.errors import BundleError
from anytraverse.perception import DefaultThresholds
from anytraverse.perception.resizing import Fit
from anytraverse.regular_file import read_regular

CHECKS = "checks"
"""The folder in a bundle for the records of checks, one file a machine."""


class BundleWriter:
    """Collects a bundle's files in a temporary folder beside `out`, and renames it to `out` when finished.

        with BundleWriter(out) as writer:
            (writer.folder / "image.onnx").write_bytes(...)
            writer.finish(kind=...)

    A bundle that is already at `out` is replaced; for anything else there, entering raises BundleError.
    Without `finish`, and after an error or Ctrl-C, no file remains. A missing parent folder is made.
    """

    def __init__(self, out: Path, say: Callable[[str], None] | None = None) -> None:
        self.out = out.resolve()
        self._say = say or (lambda _: None)
        self._folder: Path | None = None

    @property
    def folder(self) -> Path:
        """The folder to write the files to; subfolders are allowed."""
        if self._folder is None:
            raise RuntimeError("a BundleWriter is used in a with statement, until it is finished")
        return self._folder

    def __enter__(self) -> BundleWriter:
        check_place(self.out)
        self.out.parent.mkdir(parents=True, exist_ok=True)
        for leftover in sorted(self.out.parent.glob(f".{glob.escape(self.out.name)}.*.part")):
            self._say(f"left by one that was killed, unless it is still at work: rm -r {leftover}")
        self._folder = _temporary_folder_beside(self.out, "part")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
            self._folder = None

    def finish(
        self,
        *,
        kind: str,
        name: str,
        model_id: str,
        image: Fit,
        scene: str,
        thresholds: DefaultThresholds,
        variants: Mapping[str, Mapping[str, str]],
        source: Mapping[str, str],
        details: Mapping[str, Any] | None = None,
        scene_image: Fit | None = None,
    ) -> Manifest:
        """Hash the files, write the manifest, rename the folder to `out`. Raises BundleError, OSError."""
        # a bundle has no measured numbers for many remembered scenes: `scene` counts for any number
        limits = {name: getattr(thresholds, name) for name in ("roi", "scene", "tile", "tile_share")}
        if thresholds.tile_share == DefaultThresholds.tile_share:
            del limits["tile_share"]  # so that an older release reads the bundle
        values = {
            "format": FORMAT,
            "kind": kind,
            "name": name,
            "model_id": model_id,
            "image": asdict(image),
            "scene": scene,
            "scene_image": None if scene_image is None else asdict(scene_image),
            "thresholds": limits,
            "variants": {precision: dict(parts) for precision, parts in variants.items()},
            "details": dict(details or {}),
            "source": dict(source),
            "files": {name: self._entry(path) for name, path in _files_of(self.folder)},
        }
        try:
            text = json.dumps(values, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
            (self.folder / MANIFEST).write_bytes(text.encode("utf-8"))
        except (TypeError, ValueError) as error:
            raise BundleError(f"what the manifest should say is not JSON: {error}") from error
        manifest = read_manifest(self.folder)  # refuses what a rover would refuse
        _flush(self.folder)
        check_place(self.out, kind)  # again, since the place may have changed, and now with the kind
        _put_in_place(self.folder, self.out)
        self._folder = None
        return manifest

    def _entry(self, path: Path) -> dict[str, Any]:
        size = path.stat().st_size
        self._say(f"{path.relative_to(self.folder)}  {size / 1e6:.1f} MB")
        return {"size": size, "sha256": sha256_of(path)}


def _files_of(folder: Path) -> list[tuple[str, Path]]:
    """Return name and path of every file below `folder` but the manifest. Raises BundleError for a link."""
    found = []
    for path in sorted(folder.rglob("*")):
        if path.is_symlink() or not (path.is_file() or path.is_dir()):
            raise BundleError(f"{path} is neither a file nor a folder: a bundle holds nothing else")
        if path.is_file() and path != folder / MANIFEST:
            found.append((path.relative_to(folder).as_posix(), path))
    return found


def check_place(out: Path, kind: str | None = None) -> None:
    """Raise BundleError when something is at `out` that a new bundle must not replace.

    kind: of the new bundle, which replaces only a bundle of the same kind; None: not known yet.
    """
    if not out.exists():
        return
    if not out.is_dir():
        raise BundleError(f"{out} is a file: give the name of a folder")
    lying = {path.relative_to(out).as_posix() for path in out.rglob("*") if not path.is_dir()}
    if not lying and not any(out.iterdir()):
        return
    try:
        fields = parse_object(read_regular(out / MANIFEST, LARGEST_MANIFEST), str(out / MANIFEST))
        known = {MANIFEST, *fields.object("files")} if fields.any("format") else set()
        lies_there = fields.any("kind")
    except (BundleError, OSError):
        raise BundleError(
            f"{out} exists and is not a bundle: give another name, or move it away yourself"
        ) from None
    if kind is not None and lies_there != kind:
        raise BundleError(
            f'{out} is a bundle of kind "{lies_there}", and the new one would be "{kind}": give another name'
        )
    foreign = sorted(name for name in lying - known if not name.startswith(f"{CHECKS}/"))
    if foreign:
        raise BundleError(
            f"{out} is a bundle with files that are not its own ({', '.join(foreign[:3])}): "
            "move them away, or give another name"
        )


def _temporary_folder_beside(out: Path, suffix: str) -> Path:
    folder = Path(tempfile.mkdtemp(prefix=f".{out.name}.", suffix=f".{suffix}", dir=out.parent))
    umask = os.umask(0)
    os.umask(umask)
    folder.chmod(0o777 & ~umask)  # mkdtemp makes it private, but the daemon runs as another user
    return folder


def _put_in_place(folder: Path, out: Path) -> None:
    """Rename `folder` to `out`; if that fails, rename the old bundle back."""
    if not out.exists() or not any(out.iterdir()):
        folder.rename(out)
    else:
        old = _temporary_folder_beside(out, "old")
        try:
            out.rename(old)
            folder.rename(out)
        finally:
            if not out.exists():
                old.rename(out)
            shutil.rmtree(old, ignore_errors=True)
    _flush_folder(out.parent)


def _flush(folder: Path) -> None:
    """Write the page cache of a folder to the disk: a USB stick may be pulled right afterwards."""
    for path in (*folder.rglob("*"), folder):
        if path.is_dir():
            _flush_folder(path)
        else:
            with path.open("rb") as file:
                os.fsync(file.fileno())


def _flush_folder(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
