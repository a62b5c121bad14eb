"""Implements `companion look-ground`: draws into a picture where the configured mount puts the ground."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from anytraverse.drawing import (
    AMBER,
    PAPER,
    VERMILION,
    YELLOW,
    Colour,
    fitted,
    outline,
    text_width,
    write,
    write_png,
)
from anytraverse.frame import Image
from anytraverse.ground import RELIABLE, WIDEST, GroundCamera
from anytraverse.ground_lines import ASSUMED_WIDTH, GroundLine, LineKind, horizon_row
from anytraverse.look import read_picture
from anytraverse.regions import Box, Region
from companion.cameras.folder import SUFFIXES
from companion.config import Config, load_config
from companion.config.stopping import Stopping, ground_region, judge_stopping, lines_of, region_of
from companion.desk.drives.drive import DriveError
from companion.desk.drives.frames import open_drive

_BLUE: Colour = (86, 180, 233)
_RIM: Colour = (20, 20, 20)
_COLOURS: dict[LineKind, Colour] = {
    "horizon": _BLUE,
    "metre": _BLUE,
    "side": YELLOW,
    "assumed": AMBER,
    "stop": VERMILION,
}
_SMALLEST = 960
"""Pixels of width below which a picture is enlarged, so that lines and labels do not hide it."""
_DASHES = 24
_LABEL = 16


class MountError(Exception):
    """Reports that it is not known how the camera is mounted. The text says what to set."""


def run(where: str, *, file: str, out: str) -> int:
    """Draw the ground into a picture and print where it is. Returns 0.

    Raises MountError, ConfigError, DriveError, AnyTraverseError and OSError.
    """
    config = load_config(file)
    camera = config.ground_camera
    if camera is None:
        raise MountError(f"{file}: {missing(config)}")
    picture = first_picture(where, config.camera.rate)
    region = region_of(config)
    write_png(out, draw(picture, lines_of(config), region))
    print(f"{where}: {_mount(camera, config)}")
    for name, text in _told(camera, config, picture.shape[0], region.bounds):
        print(f"  {name:9} {text}")
    if wrong := wrong_aspect(config, picture):
        print(f"  WARNING   {wrong}")
    print(f"  picture   {out}")
    return 0


def first_picture(where: str, rate: float) -> Image:
    """Read a picture file, or the first frame of a drive. Raises what `open_drive` and `read_picture` do."""
    if Path(where).suffix.lower() in SUFFIXES:
        return read_picture(where)
    for frame in open_drive(where, rate).frames():
        if frame.image is not None:
            return frame.image
    raise DriveError(f"{where} has no frame that can be read: give a picture")


def draw(picture: Image, lines: Sequence[GroundLine], region: Region) -> Image:
    """Return the picture, not below `_SMALLEST` pixels wide, with the lines and the region of interest."""
    canvas = np.ascontiguousarray(fitted(picture, max(_SMALLEST, picture.shape[1])))
    outline(canvas, region, PAPER, 1)
    (left, top), *_ = region.corners
    _write(canvas, "region", (left, top + 0.03), PAPER, to_left=False)
    for line in lines:
        _draw_line(canvas, line)
    for line in lines:  # over all lines
        _write(canvas, line.label, line.labelled, _COLOURS[line.kind], to_left=line.kind != "stop")
    return canvas


def _draw_line(canvas: Image, line: GroundLine) -> None:
    height, width = canvas.shape[:2]
    start, end = np.array([line.start, line.end]) * (width - 1, height - 1)
    thickness = 4 if line.kind == "stop" else 1
    parts = np.linspace(start, end, 2 * _DASHES if line.kind == "assumed" else 2).round().astype(int)
    for colour, thick in ((_RIM, thickness + 2), (_COLOURS[line.kind], thickness)):
        for first, last in zip(parts[::2].tolist(), parts[1::2].tolist(), strict=True):
            cv2.line(canvas, first, last, colour, thick, cv2.LINE_AA)


def _write(canvas: Image, text: str, at: tuple[float, float], colour: Colour, *, to_left: bool) -> None:
    """Write a label above a place, to its left or to its right, inside the picture."""
    height, width = canvas.shape[:2]
    across = text_width(text, _LABEL, bold=True)
    left = round(at[0] * width) - (across + 4 if to_left else -4)
    place = (min(max(left, 4), width - across - 4), min(max(round(at[1] * height) - 5, _LABEL), height - 5))
    for rim in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        write(canvas, text, (place[0] + rim[0], place[1] + rim[1]), _LABEL, _RIM, bold=True)
    write(canvas, text, place, _LABEL, colour, bold=True)


def wrong_aspect(config: Config, picture: Image) -> str:
    """Say that a picture has another shape than the mount; "" where it has the same."""
    aspect, (height, width) = config.mount.aspect, picture.shape[:2]
    if config.mount.has_shape(width, height):
        return ""
    return (
        f"the picture is {width} x {height}, and [mount] aspect is {aspect:g}: where it "
        f"is the rover's own, set aspect to {width / height:.3f}; else the lines are wrong"
    )


def missing(config: Config) -> str:
    """Say what to set, so that it is known where the camera is."""
    if config.mount.height is None:
        return (
            "it is not known where the camera is: measure, and set [mount] height (m of the lens above the "
            "ground) and tilt (degrees of its axis below the horizon)"
        )
    return (
        f"[camera] view is {config.camera.view:g} degrees: beyond {WIDEST:g} no lens is a pinhole, and the "
        "ground cannot be told"
    )


def _mount(camera: GroundCamera, config: Config) -> str:
    turned = [
        f", {name} {degrees:g} degrees"
        for name, degrees in (("roll", camera.roll), ("heading", camera.heading))
        if degrees
    ]
    return (
        f"height {camera.height:g} m, tilt {camera.tilt:g} degrees{''.join(turned)}, view "
        f"{config.camera.view:g} degrees, front {camera.front:g} m ahead of the lens"
    )


def _told(camera: GroundCamera, config: Config, height: int, box: Box) -> list[tuple[str, str]]:
    """Return what is said of the picture: what of it, and where that is."""
    row, middle = horizon_row(camera), (box.left + box.right) / 2
    side = {row < 0: " (above the picture)", row > 1: " (below the picture)"}.get(True, "")
    upper, lower = _ahead(camera, middle, box.top), _ahead(camera, middle, box.bottom)
    width, ground = config.mount.width, ground_region(config)
    region = f"upper side {upper}, lower side {lower}"
    if ground is not None:
        region = f"{ground.near:.1f} to {ground.far:.1f} m ahead, {ground.width:.1f} m wide"
    judged = judge_stopping(config)
    stops = judged if isinstance(judged, str) else _stops(judged)
    return [
        ("horizon", f"row {row:.2f} of the height, {row * height:.0f} of {height} pixels{side}"),
        ("nearest", f"the lowest row shows the ground {_ahead(camera, 0.5, 1.0)}"),
        ("region", region),
        ("width", f"{width:g} m" if width else f"not known, {ASSUMED_WIDTH:g} m is drawn: set [mount] width"),
        ("stops", stops),
    ]


def _ahead(camera: GroundCamera, across: float, row: float) -> str:
    """Say how far ahead of the vehicle's front a place of the picture meets the ground."""
    metres = float(camera.to_ground(np.array([[across, row]]))[0, 0]) - camera.front
    if np.isnan(metres):
        return "nowhere (it is above the horizon)"
    if metres < 0:
        return "behind the vehicle's front"
    return f"{metres:.1f} m ahead{_beyond(metres)}"


def _stops(judged: Stopping) -> str:
    return f"in {judged.needs:.1f} m at {judged.speed:g} m/s{_beyond(judged.needs)}"


def _beyond(metres: float) -> str:
    return f" (beyond {RELIABLE:g} m no distance is reliable)" if metres > RELIABLE else ""
