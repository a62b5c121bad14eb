"""Reads a lens's calibration from the file that OpenCV's sample or ROS's camera_calibration writes.

OpenCV's own reader of such files ends the whole process at some damaged ones, so it is not used. Only the
keys that are needed are looked at.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from anytraverse.frame import Intrinsics
from anytraverse.regular_file import read_regular
from anytraverse.release import to_install
from companion.cameras.shown import shown

_LARGEST = 1 << 20
"""Bytes. OpenCV's sample may write the corners that it found in each picture, too."""
_LONGEST_NUMBER = 40
_COUNTS = (4, 5, 8, 12, 14)
"""Distortion coefficients of OpenCV's pinhole models."""
_MODELS = ("plumb_bob", "rational_polynomial")
_FISHEYE = ("equidistant", "fisheye", "kannala_brandt")
NARROWEST, _WIDEST = 10.0, 170.0
"""Degrees of a rectified picture."""
_SAMPLES = 33
_KEY = re.compile(r'([ \t]*)"?([A-Za-z_]\w*)"?[ \t]*:(?:[ \t]+(.*))?', re.ASCII)
_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")

_NOT_OURS = "is no calibration by OpenCV (YAML, XML, JSON) or ROS's camera_calibration: calibrate again"

_Table = Mapping[str, str]
"""A key's value by the keys inside it; by "" where it has none."""


class CalibrationError(Exception):
    """The file cannot be used. The text names it, and says what to do."""


@dataclass(frozen=True)
class LensCalibration:
    """A calibrated lens, by OpenCV's model.

    width, height: of the pictures that it was calibrated with. lens: of these pictures. distortion: OpenCV's
    coefficients, 4, 5, 8, 12 or 14. view: degrees that a rectified picture shows horizontally, the most
    without a border that the lens did not see. Its pixels are square, and the lens axis is in its middle.
    """

    width: int
    height: int
    lens: Intrinsics
    distortion: tuple[float, ...]
    view: float = NARROWEST

    @property
    def aspect(self) -> float:
        """Width by height."""
        return self.width / self.height

    @property
    def rectified(self) -> Intrinsics:
        """The lens of the rectified picture, over its width and height, whose edges are 0 and 1."""
        focal = 0.5 / math.tan(math.radians(self.view / 2.0))
        return focal, focal * self.aspect, 0.5, 0.5

    def misfit(self, width: int, height: int) -> str:
        """Say what is wrong with pictures of this size; "" where they have the shape, within a pixel."""
        if abs(width / self.aspect - height) <= 1.0:
            return ""
        return (
            f"the pictures are {width} x {height}, and the calibration is of {self.width} x {self.height}: "
            "calibrate in the shape of the pictures, or make [camera] width and height so"
        )

    def fits(self, view: float) -> bool:
        """Whether the lens saw each pixel of a rectified picture of this view, and none of them twice."""
        import cv2

        fx, fy, cx, cy = self.lens
        tangent = math.tan(math.radians(view / 2.0)) * (1.0 - 1.0 / self.width)
        upwards = math.tan(math.radians(view / 2.0)) * (self.height - 1.0) / self.width
        across, down = np.meshgrid(
            np.linspace(-tangent, tangent, _SAMPLES), np.linspace(-upwards, upwards, _SAMPLES)
        )
        rays = np.stack([across, down, np.ones_like(across)], axis=-1).reshape(-1, 1, 3)
        matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        seen, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), matrix, np.array(self.distortion))
        x, y = np.moveaxis(seen.reshape(_SAMPLES, _SAMPLES, 2), -1, 0)
        inside = (x >= 0.0) & (x <= self.width - 1.0) & (y >= 0.0) & (y <= self.height - 1.0)
        return bool(inside.all() and (np.diff(x, axis=1) > 0.0).all() and (np.diff(y, axis=0) > 0.0).all())


def read_calibration(path: Path) -> LensCalibration:
    """Read a file: YAML, XML or JSON of OpenCV's FileStorage, or ROS's YAML. Raises CalibrationError."""
    try:
        return _calibration(_text(read_regular(path, _LARGEST + 1)))
    except FileNotFoundError:
        raise CalibrationError(
            f"there is no file {shown(str(path))}: docs/cameras.md says how to make it"
        ) from None
    except OSError as error:
        raise CalibrationError(
            f"{shown(str(path))} cannot be read: {(error.strerror or str(error)).lower()}"
        ) from None
    except ImportError as error:
        raise CalibrationError(f"needs {error.name}: {to_install('rover')}") from error
    except CalibrationError as error:
        raise CalibrationError(f"{shown(str(path))} {error}") from None


def _text(content: bytes) -> str:
    if len(content) > _LARGEST:
        raise CalibrationError("is larger than 1 MiB: write it without the points of the pictures")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise CalibrationError(_NOT_OURS) from None


def _calibration(text: str) -> LensCalibration:
    found = _tables(text)
    model = found.get("distortion_model", {}).get("", "").strip(" \t\"'") or _MODELS[0]
    if model in _FISHEYE or found.get("fisheye_model", {}).get("", "0").strip() != "0":
        raise CalibrationError(
            "is of a fisheye model, which is not rectified: calibrate without it (plumb_bob or "
            "rational_polynomial), or let the camera's own program straighten the pictures"
        )
    if model not in _MODELS:
        raise CalibrationError(f"has a distortion_model that is not {' or '.join(_MODELS)}: take one")
    width, height = _pixels(found, "image_width"), _pixels(found, "image_height")
    if not 0.3 <= width / height <= 5.0:
        raise CalibrationError("has an image_width that does not fit its image_height: calibrate again")
    matrix = _matrix(found, "camera_matrix")
    if len(matrix) != 9 or (matrix[1], matrix[3], *matrix[6:]) != (0.0, 0.0, 0.0, 0.0, 1.0):
        raise CalibrationError("has a camera_matrix that is not fx 0 cx, 0 fy cy, 0 0 1: calibrate again")
    fx, _, cx, _, fy, cy, *_ = matrix
    if fx <= 0.0 or fy <= 0.0:
        raise CalibrationError("has a focal length in camera_matrix that is not above 0: calibrate again")
    if not (0.0 < cx < width and 0.0 < cy < height):
        raise CalibrationError("has the centre of its camera_matrix outside of the picture: calibrate again")
    distortion = _matrix(found, "distortion_coefficients")
    if len(distortion) not in _COUNTS:
        counts = f"{', '.join(map(str, _COUNTS[:-1]))} or {_COUNTS[-1]}"
        raise CalibrationError(f"has {len(distortion)} distortion_coefficients: calibrate with {counts}")
    return _with_view(LensCalibration(width, height, (fx, fy, cx, cy), tuple(distortion)))


def _with_view(lens: LensCalibration) -> LensCalibration:
    """Return the calibration with the widest view that fits."""
    low, high = NARROWEST, _WIDEST
    if not lens.fits(low):
        raise CalibrationError(
            f"leaves less than {low:g} degrees that can be rectified: calibrate again, with the pattern also "
            "in the corners of the picture"
        )
    while high - low > 0.001:
        middle = (low + high) / 2.0
        low, high = (middle, high) if lens.fits(middle) else (low, middle)
    return replace(lens, view=math.floor(100.0 * low) / 100.0)


def _pixels(found: Mapping[str, _Table], key: str) -> int:
    numbers = _numbers(_given(found, key).get("", ""), key)
    if len(numbers) != 1 or not (16 <= numbers[0] <= 8192 and numbers[0].is_integer()):
        raise CalibrationError(f"has an {key} that is no whole number from 16 to 8192: calibrate again")
    return int(numbers[0])


def _matrix(found: Mapping[str, _Table], key: str) -> list[float]:
    table = _given(found, key)
    rows, columns, data = (_numbers(table.get(name, ""), key) for name in ("rows", "cols", "data"))
    if len(rows) != 1 or len(columns) != 1 or rows[0] * columns[0] != len(data):
        raise CalibrationError(f"has a {key} whose rows, cols and data do not fit together: calibrate again")
    return data


def _given(found: Mapping[str, _Table], key: str) -> _Table:
    if key not in found:
        raise CalibrationError(f"has no {key}: name the file that the calibration wrote")
    return found[key]


def _numbers(text: str, key: str) -> list[float]:
    """Return the numbers of a list in brackets, of lines with dashes, or between spaces."""
    words = [word for word in re.sub(r"[\[\],]", " ", text).split() if word != "-"]
    numbers = [
        float(word) if len(word) <= _LONGEST_NUMBER and _NUMBER.fullmatch(word) else math.nan
        for word in words
    ]
    if not all(map(math.isfinite, numbers)):
        raise CalibrationError(f"has something in {key} that is no finite number: calibrate again")
    return numbers


def _tables(text: str) -> Mapping[str, _Table]:
    """Return the values of the outermost keys, in small letters: older programs write image_Width."""
    try:
        match text.lstrip()[:1]:
            case "{":
                return _json(text)
            case "<":
                return _xml(text)
    except (ValueError, RecursionError, ElementTree.ParseError):
        raise CalibrationError(_NOT_OURS) from None
    return _yaml(text)


def _once(pairs: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key.lower() in found:
            raise CalibrationError("has a key twice: keep one calibration in it")
        found[key.lower()] = value
    return found


def _json(text: str) -> Mapping[str, _Table]:
    comment = re.compile(r"^[ \t]*//.*$", re.MULTILINE)  # FileStorage's
    content = json.loads(comment.sub("", text), object_pairs_hook=_once)
    return {
        key: {name: str(one) for name, one in value.items()} if isinstance(value, dict) else {"": str(value)}
        for key, value in content.items()
    }


def _xml(text: str) -> Mapping[str, _Table]:
    if "<!DOCTYPE" in text:  # its entities could make gigabytes
        raise CalibrationError(_NOT_OURS)
    root = ElementTree.fromstring(text)
    return _once(
        (one.tag, {"": one.text or "", **{inner.tag: inner.text or "" for inner in one}}) for one in root
    )


def _yaml(text: str) -> Mapping[str, _Table]:
    pairs: list[tuple[str, dict[str, list[str]]]] = []
    at = ""
    for line in text.splitlines():
        line = re.split(r"(?:^|[ \t])#", line, maxsplit=1)[0]  # noqa: PLW2901
        key = _KEY.fullmatch(line.rstrip())
        if key and not key[1]:
            at = ""
            pairs.append((key[2], {at: [key[3] or ""]}))
        elif key and pairs:
            at = key[2]
            pairs[-1][1][at] = [key[3] or ""]
        elif pairs and not line.startswith(("---", "...", "%")):
            pairs[-1][1][at].append(line)
    return _once((key, {name: " ".join(one) for name, one in table.items()}) for key, table in pairs)
