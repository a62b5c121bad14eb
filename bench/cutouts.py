"""Unpacks photographs of things without a background, for training and for `make bench-perception`.

They come from the Debian package tuxpaint-stamps-default (GPL-2): photographs of animals, vehicles, tools and
fruit with an opacity channel. Drawings and plants are left out. Nothing of the package is part of this
project. DIR/train/NAME.png is for training; DIR/held_out/KIND/NAME.png is never trained on.
Run: python -m bench.cutouts DIR [--package FILE.deb]
"""

from __future__ import annotations

import argparse
import json
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from anytraverse.frame import Image

PACKAGE = "tuxpaint-stamps-default"
HELD_OUT: dict[str, tuple[str, ...]] = {
    "person": ("fireman200b", "fireman240a"),
    "vehicle": ("beetle", "truck", "dumper", "dumper_mirror", "bradley", "bradley_mirror", "garbagetruck"),
    "barrel": ("garbagecan", "wheelie_bin", "drum_tomtom_floor"),
    "animal": ("dog", "dingo", "sheep", "sheep_lamb", "deer", "doe", "cow", "wildboar", "fox", "goat", "hen"),
    "rock": ("inukshuk-photo", "potato", "walnut"),
    "thing": ("traffic_cone", "toolbox", "soccer", "rubberduck", "kettle"),
}
"""Kind -> names of the package's pictures that are kept for tests."""

_KINDS = ("animals", "food", "hobbies", "household", "military", "people", "sports", "town", "vehicles")
_DRAWN = ("cartoon", "roadsigns/arrow", "roadsigns/hospital", "inukshuk-outline", "kangaroo-silo", "flags")
_LEAST_COLOURS = 200  # of 32 levels a channel: a drawing has fewer
_LARGEST = 320  # pixels of the longer side
_OPAQUE = 200


def cutouts(root: Path) -> dict[str, Image]:
    """Return name -> BGRA picture, (h, w, 4) uint8, of the package's photographs, cut to the thing."""
    found = {}
    for path in sorted(p for kind in _KINDS for p in (root / kind).rglob("*.png")):
        if any(drawn in str(path.relative_to(root)) for drawn in _DRAWN):
            continue
        picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        if picture is None or picture.ndim != 3 or picture.shape[2] != 4 or picture.dtype != np.uint8:
            continue
        solid = picture[..., 3] > _OPAQUE
        if len(np.unique(picture[solid][:, :3] // 8, axis=0)) < _LEAST_COLOURS:
            continue
        left, top, wide, high = cv2.boundingRect(solid.astype(np.uint8))
        thing = picture[top : top + high, left : left + wide]
        scale = min(1.0, _LARGEST / max(wide, high))
        size = max(1, round(wide * scale)), max(1, round(high * scale))
        found[path.stem] = np.asarray(cv2.resize(thing, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    return found


def unpack(package: Path | None, folder: Path) -> Path:
    """Unpack the package, downloaded with apt-get if none is given, into `folder`; return the pictures' root.

    Raises CalledProcessError, FileNotFoundError when there is no apt-get or no dpkg-deb.
    """
    if package is None:
        subprocess.run(["apt-get", "download", PACKAGE], cwd=folder, check=True, timeout=600)
        package = next(folder.glob("*.deb"))
    subprocess.run(["dpkg-deb", "-x", package, folder / "unpacked"], check=True, timeout=120)
    return folder / "unpacked/usr/share/tuxpaint/stamps"


def main() -> None:
    """Write the cut-outs; print how many as one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, metavar="DIR")
    parser.add_argument("--package", type=Path, help="the downloaded package; by default apt-get fetches it")
    given = parser.parse_args()
    held = {name: kind for kind, names in HELD_OUT.items() for name in names}
    counts: dict[str, int] = {}
    with TemporaryDirectory() as temporary:
        for name, picture in cutouts(unpack(given.package, Path(temporary))).items():
            part = f"held_out/{held[name]}" if name in held else "train"
            (given.folder / part).mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(given.folder / part / f"{name}.png"), picture)
            counts[part] = counts.get(part, 0) + 1
    print(json.dumps(counts))


if __name__ == "__main__":
    main()
