"""Reads and checks a bundle's manifest, and verifies its files.

A bundle is a folder that can be copied: networks, what they need (a tokenizer, class names), and a
`manifest.json` that describes them and gives each file's size and hash. Other files in the folder, such as
the records of checks, belong to the machine that they are stored on.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from anytraverse.bundle.fields import Fields, parse_object
from anytraverse.bundle.files import FileEntry, check_contents, check_size
from anytraverse.bundle.files import sha256_of as sha256_of  # noqa: PLC0414
from anytraverse.errors import BundleError, PerceiverError
from anytraverse.perception import DefaultThresholds
from anytraverse.perception.resizing import FILTERS, LARGEST, Fit
from anytraverse.regular_file import read_regular

MANIFEST = "manifest.json"
FORMAT = 1
SCENES = ("shared", "clip-b32", "own")
"""Where the scene embedding comes from: CLIPSeg's own tower, CLIP ViT-B/32 as in the paper, or the model."""

LARGEST_MANIFEST = 16 << 20
LARGEST_FILE = 1 << 40
_FILE_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._+-]*(/[A-Za-z0-9_][A-Za-z0-9._+-]*)*", re.ASCII)
_SHA256 = re.compile(r"[0-9a-f]{64}", re.ASCII)
_FIELDS = (
    "format",
    "kind",
    "name",
    "model_id",
    "image",
    "scene",
    "scene_image",
    "thresholds",
    "variants",
    "details",
    "source",
    "files",
)


@dataclass(frozen=True)
class Manifest:
    """Describes a bundle.

    kind: the perceiver that runs it. name: for people. model_id: see `Perceiver.model_id`.
    image: how a frame becomes the input. scene: one of `SCENES`; scene_image: the input of its own encoder.
    thresholds: suit these weights. variants: precision -> part -> file name; "fp32" is always there.
    details: read only by the kind's perceiver. source: origin and licence of the weights, and the like.
    files: file name -> its size and hash.
    """

    kind: str
    name: str
    model_id: str
    image: Fit
    scene: str
    scene_image: Fit | None
    thresholds: DefaultThresholds
    variants: Mapping[str, Mapping[str, str]]
    details: Mapping[str, Any]
    source: Mapping[str, str]
    files: Mapping[str, FileEntry]

    def needed(self, precision: str) -> list[str]:
        """Return the names of the files that a variant needs, also those that it takes from fp32."""
        parts = self.parts(precision)
        networks = {Path(name).with_suffix("").as_posix() for name in parts.values()}
        weights = {f"{name}.weights" for name in networks}
        return [name for name in self.files if name in parts.values() or name in weights]

    def parts(self, precision: str) -> dict[str, str]:
        """Return part -> file name; a part that the variant lacks is taken from fp32. Raises BundleError."""
        if precision not in self.variants:
            raise BundleError(
                f'the bundle "{self.name}" carries no {precision} variant, only {", ".join(self.variants)}: '
                f"export it with --precision fp32,{precision}"
            )
        return {**self.variants["fp32"], **self.variants[precision]}

    def file(self, precision: str, part: str) -> str:
        """Return the name of a part's file. Raises BundleError."""
        parts = self.parts(precision)
        if part not in parts:
            raise BundleError(f'the bundle "{self.name}" has no part "{part}": export it again')
        return parts[part]


def read_manifest(folder: Path, kind: str | None = None) -> Manifest:
    """Read the manifest of the bundle in `folder`, and check that every file exists and has its size.

    The files' contents are not read: `verify` does that. Raises BundleError, also when the bundle is not of
    `kind`.
    """
    fields = parse_object(_manifest_bytes(folder), str(folder / MANIFEST))
    came = fields.any("format")
    if isinstance(came, int) and not isinstance(came, bool) and came > FORMAT:
        raise BundleError(
            f"{folder} is a bundle of format {came}, this program reads up to {FORMAT}: update this program"
        )
    fields.whole("format", 1, FORMAT)
    manifest = _manifest(fields)
    if kind is not None and manifest.kind != kind:
        raise BundleError(
            f'{folder} is a bundle of kind "{manifest.kind}", not "{kind}": '
            f"give it as {manifest.kind}:{folder}, or export one of kind {kind}"
        )
    for name, entry in manifest.files.items():
        check_size(folder, name, entry)
    return manifest


def manifest_digest(folder: Path) -> str:
    """Calculate the SHA-256 of the manifest. The manifest holds all files' hashes, so it covers these too."""
    return hashlib.sha256(_manifest_bytes(folder)).hexdigest()


def verify(
    folder: Path,
    manifest: Manifest,
    say: Callable[[str], None] | None = None,
    *,
    precision: str | None = None,
) -> None:
    """Compare the SHA-256 of all files, or of those that one variant needs.

    say: receives a line for each file. Raises BundleError for the first damaged file.
    """
    names = manifest.files if precision is None else manifest.needed(precision)
    for name in names:
        entry = manifest.files[name]
        check_contents(folder, name, entry)
        if say is not None:
            say(f"{name}  {entry.size / 1e6:.1f} MB  ok")


def _manifest_bytes(folder: Path) -> bytes:
    path = folder / MANIFEST
    try:
        data = read_regular(path, LARGEST_MANIFEST + 1)
    except (FileNotFoundError, NotADirectoryError):
        raise BundleError(
            f"{folder} is not a bundle, it has no {MANIFEST}: "
            "give the folder that `anytraverse export` or `anytraverse bundle classes` wrote, copied whole"
        ) from None
    except PermissionError:
        raise BundleError(f"{path} may not be read by this user: chmod -R a+rX {folder}") from None
    except (OSError, ValueError) as error:
        raise BundleError(f"{path} cannot be read ({error}): copy the bundle again") from None
    if len(data) > LARGEST_MANIFEST:
        raise BundleError(
            f"{path} has more than {LARGEST_MANIFEST >> 20} MiB: this is not a bundle's manifest"
        )
    return data


def _manifest(fields: Fields) -> Manifest:
    fields.only(_FIELDS)
    entries = fields.object("files")
    files = {_file_name(entries, name): _entry(entries.object(name)) for name in entries}
    scene = fields.choice("scene", SCENES)
    scene_image = None if fields.any("scene_image") is None else _fit(fields.object("scene_image"))
    if scene == "clip-b32" and scene_image is None:
        raise fields.unfit("scene_image", "the input of the scene's encoder", "null")
    source = fields.object("source")
    return Manifest(
        kind=fields.text("kind"),
        name=fields.text("name"),
        model_id=fields.text("model_id"),
        image=_fit(fields.object("image")),
        scene=scene,
        scene_image=scene_image,
        thresholds=_thresholds(fields.object("thresholds")),
        variants=_variants(fields.object("variants"), files),
        details=fields.mapping("details"),
        source={name: source.text(name, empty=True) for name in source},
        files=files,
    )


def _file_name(entries: Fields, name: str) -> str:
    if not _FILE_NAME.fullmatch(name) or len(name) > 200 or name == MANIFEST:
        raise entries.unfit(f"the name {name[:60]!r}", "letters, digits, . _ + - inside the folder", "unfit")
    return name


def _entry(fields: Fields) -> FileEntry:
    fields.only(("size", "sha256"))
    digest = fields.text("sha256")
    if not _SHA256.fullmatch(digest):
        raise fields.unfit("sha256", "64 hexadecimal digits", repr(digest[:70]))
    return FileEntry(fields.whole("size", 0, LARGEST_FILE), digest)


def _fit(fields: Fields) -> Fit:
    fields.only(("width", "height", "filter", "crop"))
    width = fields.whole("width", 1, LARGEST)
    height = fields.whole("height", 1, LARGEST)
    try:
        return Fit(width, height, fields.choice("filter", FILTERS), fields.flag("crop"))
    except PerceiverError as error:
        raise BundleError(f"{fields.where}: {error}") from None


def _thresholds(fields: Fields) -> DefaultThresholds:
    fields.only(("roi", "scene", "tile", "tile_share"))
    share = DefaultThresholds.tile_share  # of older bundles, and of those that leave it out
    return DefaultThresholds(
        roi=fields.number("roi", 1e-6, 1.0),
        scene=fields.number("scene", -1.0, 1.0),
        tile=None if fields.any("tile") is None else fields.number("tile", 1e-6, 1.0),
        tile_share=fields.number("tile_share", 1e-6, 1.0) if "tile_share" in fields else share,
    )


def _variants(fields: Fields, files: Mapping[str, FileEntry]) -> dict[str, dict[str, str]]:
    variants: dict[str, dict[str, str]] = {}
    for precision in fields:
        parts = fields.object(precision)
        variants[precision] = {part: parts.choice(part, files) for part in parts}
    if "fp32" not in variants:
        raise fields.unfit("fp32", "a variant that is always there", "missing")
    return variants
