"""Measures how a frozen camera's pictures differ from a creeping rover's.

Run: python bench/still_pictures.py FOLDER...

It counts how many of a picture's 48 regions change when the picture stands still but is compressed again, or
gets noise or another time on its clock, and how many when the rover has driven on by so many metres. The
picture after driving on is computed from one frame: the ground moves by its distance (a lens 1.2 m high, a
field of view of 70 degrees, the horizon at 42 % of the height), and upright things, taken to be 25 m away,
come nearer.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from companion.vision.freeze_detector import CHANGED_REGIONS, changed_regions, luma

Picture = NDArray[np.uint8]
_FRAMES = 40
_LIGHT = {
    "as it is": (1.0, 0.0),
    "15 % of the light": (0.15, 0.0),
    "fog, 20 % of the contrast": (0.2, 160.0),
    "fog, 8 % of the contrast": (0.08, 185.0),
}


def main(folders: list[str]) -> None:
    """Prints least, median and most regions that change, and the share judged wrongly."""
    paths = [path for folder in folders for path in sorted(Path(folder).glob("*.jpg"))]
    random = np.random.default_rng(0)
    for light, (contrast, haze) in _LIGHT.items():
        found: dict[str, list[int]] = {}
        for path in paths[:: max(1, len(paths) // _FRAMES)]:
            for kind, before, after in _pairs(_read(path), contrast, haze, random):
                found.setdefault(kind, []).append(changed_regions(luma(before), luma(after)))
        for kind, counts in found.items():
            wrong = np.mean([(count >= CHANGED_REGIONS) == kind.startswith("still") for count in counts])
            sys.stdout.write(
                f"{light:26} {kind:32} {min(counts):2} {np.median(counts):4.0f} {max(counts):3}, "
                f"wrong {100 * wrong:3.0f} %\n"
            )


def _pairs(
    frame: Picture, contrast: float, haze: float, random: np.random.Generator
) -> Iterator[tuple[str, Picture, Picture]]:
    def seen(picture: Picture, deviation: float = 2.5) -> Picture:
        noise = random.normal(0.0, deviation, picture.shape)
        return np.asarray(np.clip(picture * contrast + haze + noise, 0, 255), np.uint8)

    still = seen(frame)
    yield "still, JPEG 80 then 50", _compressed(still, 80), _compressed(still, 50)
    yield "still, JPEG 60 then 30", _compressed(still, 60), _compressed(still, 30)
    yield "still, noise of 6", seen(frame, 6.0), seen(frame, 6.0)
    clocks = (_clock(still, time) for time in ("11:08:27.15", "12:49:30.86"))
    yield "still, a clock, JPEG 80 then 50", _compressed(next(clocks), 80), _compressed(next(clocks), 50)
    for metres in (0.1, 0.2, 0.3, 0.5):
        yield f"{metres} m further", still, seen(_further(frame, metres))


def _read(path: Path) -> Picture:
    frame = cv2.resize(np.asarray(cv2.imread(str(path))), (640, 480), interpolation=cv2.INTER_AREA)
    return np.asarray(frame[..., ::-1], np.uint8)


def _compressed(picture: Picture, quality: int) -> Picture:
    content = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    return np.asarray(cv2.imdecode(content, cv2.IMREAD_COLOR), np.uint8)[..., ::-1]


def _clock(picture: Picture, time: str) -> Picture:
    shown, text = picture.copy(), f"2026-11-22 {time}"
    for colour, width in ((0, 5), (255, 2)):
        cv2.putText(shown, text, (10, 40), cv2.FONT_HERSHEY_SIMPLEX, 1.0, (colour,) * 3, width)
    return shown


def _further(picture: Picture, metres: float) -> Picture:
    """Computes what the same lens sees so many metres further on."""
    height, width = picture.shape[:2]
    focal, horizon = width / 2 / math.tan(math.radians(35.0)), 0.42 * height
    row, column = np.mgrid[0:height, 0:width].astype(np.float32)
    depth = np.minimum(focal * 1.2 / np.maximum(row - horizon, 1e-3), 25.0)
    before = depth / (depth + metres)
    x = (width / 2 + (column - width / 2) * before).astype(np.float32)
    y = (horizon + (row - horizon) * before).astype(np.float32)
    moved = cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    return np.asarray(moved, np.uint8)


if __name__ == "__main__":
    main(sys.argv[1:])
