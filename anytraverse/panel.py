"""Draws judged frames: a panel with every map, and sheets of pictures.

All public functions take and return RGB uint8 and do not change their arguments.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from anytraverse.assessment import Assessment, Maps
from anytraverse.drawing import (
    ATTENTION_STOPS,
    FAINT,
    GREEN,
    PAPER,
    SIGNED_STOPS,
    UNCERTAINTY_STOPS,
    VERMILION,
    Colour,
    Map,
    coloured,
    enlarged,
    fitted,
    outline,
    ramp,
    shortened,
    text_width,
    write,
)
from anytraverse.frame import Image
from anytraverse.judged_picture import draw_boxes, marked_box
from anytraverse.regions import Region

_MARGIN = 20
_GAP = 16
_LARGE = 440  # px, width of image and pooled maps
_CAPTION = 30
_BAR = 34
_RELIEF = 0.3  # share of the picture's own lightness in a drawn map


class _Scale(NamedTuple):
    stops: tuple[Colour, ...]
    low: float
    high: float
    labels: tuple[str, str, str]


_SIGNED = _Scale(SIGNED_STOPS, -1, 1, ("-1 not drivable", "0", "1 drivable"))
_UNCERTAIN = _Scale(UNCERTAINTY_STOPS, 0, 1, ("0 known", "", "1 unknown"))
_ATTENTION = _Scale(ATTENTION_STOPS, 0, 1, ("0", "", "1"))


def draw_panel(image: Image, assessment: Assessment, region: Region, title: str = "") -> Image:
    """Draw the image, the pooled maps and every word's map with colour bars and figures, 1392 pixels wide."""
    large = [_framed(fitted(image, _LARGE), "Image", _roi_note(assessment), None)]
    _mark(large[0], image, assessment, region)
    small: list[Image] = []
    if assessment.maps is not None:
        maps, roi = assessment.maps, assessment.roi
        trav = f"ROI mean {roi.traversability:.2f}" if roi else ""
        unc = f"ROI mean {roi.uncertainty:.2f}, worst tile {roi.worst_tile.uncertainty:.2f}" if roi else ""
        for values, name, note, scale in (
            (maps.signed, "Traversability", trav, _SIGNED),
            (maps.uncertainty, "Uncertainty", unc, _UNCERTAIN),
        ):
            large.append(_map(image, values, name, note, scale=scale, region=region, width=_LARGE))
        small = _word_maps(image, maps, assessment, region)
    rows = [_header(assessment, title), _row(large)]
    columns = _columns(len(small))
    rows += [_row(small[i : i + columns]) for i in range(0, len(small), columns)]
    width = 3 * _LARGE + 2 * _GAP + 2 * _MARGIN
    sheet = [_padded(row, width) for row in rows]
    return np.vstack([*sheet, _blank(_MARGIN // 2, width)])


def contact_sheet(tiles: Sequence[Image], columns: int, title: str = "") -> Image:
    """Arrange pictures in a grid, row by row. Raises ValueError without tiles or columns."""
    if not tiles or columns < 1:
        raise ValueError("a contact sheet needs at least one tile and one column")
    width = max(tile.shape[1] for tile in tiles)
    height = max(tile.shape[0] for tile in tiles)
    columns = min(columns, len(tiles))
    rows = -(-len(tiles) // columns)
    head = 56 if title else _GAP
    sheet = _blank(head + rows * (height + _GAP), _GAP + columns * (width + _GAP))
    if title:
        write(sheet, shortened(title, sheet.shape[1] - 2 * _GAP, 22, bold=True), (_GAP, 37), 22, bold=True)
    for index, tile in enumerate(tiles):
        row, column = divmod(index, columns)
        top, left = head + row * (height + _GAP), _GAP + column * (width + _GAP)
        sheet[top : top + tile.shape[0], left : left + tile.shape[1]] = tile
    return sheet


def _header(assessment: Assessment, title: str) -> Image:
    width = 3 * _LARGE + 2 * _GAP
    header = _blank(64, width)
    reasons = ", ".join(sorted(reason.value.replace("_", " ") for reason in assessment.reasons)) or "OK"
    colour = GREEN if assessment.ok else VERMILION
    wide = text_width(reasons, 18, bold=True) + 28
    cv2.rectangle(header, (0, 18), (wide, 50), colour, -1)
    write(header, reasons, (14, 40), 18, PAPER, bold=True)
    words = "   ".join(f"{word} {weight:+.2g}" for word, weight in assessment.words.items())
    write(header, shortened(title, width - wide - 24, 18, bold=True), (wide + 18, 32), 18, bold=True)
    write(header, shortened(words, width - wide - 24, 14), (wide + 18, 52), 14, FAINT)
    return header


def _word_maps(image: Image, maps: Maps, assessment: Assessment, region: Region) -> list[Image]:
    columns = _columns(len(maps.attention))
    width = (3 * _LARGE + 2 * _GAP - (columns - 1) * _GAP) // columns
    tiles = []
    for (word, weight), values in zip(assessment.words.items(), maps.attention, strict=True):
        inside = region.mask(*values.shape)
        note = f"ROI mean {values[inside].mean():.2f}" if inside.any() else ""
        name = f"{word}  {weight:+.2g}"
        tiles.append(_map(image, values, name, note, scale=_ATTENTION, region=region, width=width))
    return tiles


def _columns(words: int) -> int:
    """Return how many word maps stand side by side, three to five, so that rows are about equally full."""
    rows = -(-words // 5)
    return max(3, -(-words // max(1, rows)))


def _map(
    image: Image, values: Map, name: str, note: str, *, scale: _Scale, region: Region, width: int
) -> Image:
    """Draw a map in colours, shaded with the picture's lightness, with its caption and its colour bar."""
    base = fitted(image, width)
    picture = coloured(enlarged(values, width, base.shape[0]), scale.stops, scale.low, scale.high)
    relief = cv2.cvtColor(base, cv2.COLOR_RGB2GRAY).astype(np.float32)[..., None] / 255
    shaded = (picture * (1 - _RELIEF + _RELIEF * relief)).round().astype(np.uint8)
    outline(shaded, region, PAPER, 1)
    return _framed(shaded, name, note, scale)


def _framed(picture: Image, name: str, note: str, scale: _Scale | None) -> Image:
    """Add a caption above a picture, and a colour bar, or room for one, below."""
    width = picture.shape[1]
    caption = _blank(_CAPTION, width)
    write(caption, name, (0, 21), 16, bold=True)
    room = width - text_width(name, 16, bold=True) - 14
    text = shortened(note, room, 13)
    write(caption, text, (width - text_width(text, 13) - 1, 21), 13, FAINT)
    below = _blank(_BAR, width)
    if scale is not None:
        colours = ramp(scale.stops)[np.linspace(0, 255, width).round().astype(int)]
        below[6:14] = colours
        left, middle, right = scale.labels
        write(below, left, (0, 29), 12, FAINT)
        write(below, middle, ((width - text_width(middle, 12)) // 2, 29), 12, FAINT)
        write(below, right, (width - text_width(right, 12) - 1, 29), 12, FAINT)
    return np.vstack([caption, picture, below])


def _mark(tile: Image, image: Image, assessment: Assessment, region: Region) -> None:
    """Draw the boxes into the picture inside a framed tile."""
    height = fitted(image, tile.shape[1]).shape[0]
    draw_boxes(tile[_CAPTION : _CAPTION + height], region, marked_box(assessment))


def _roi_note(assessment: Assessment) -> str:
    return "white: ROI" if marked_box(assessment) is None else "white: ROI, yellow: look here"


def _blank(height: int, width: int) -> Image:
    return np.full((height, width, 3), PAPER, dtype=np.uint8)


def _row(tiles: Sequence[Image]) -> Image:
    """Put tiles side by side with gaps, aligned at the top."""
    height = max(tile.shape[0] for tile in tiles)
    parts: list[Image] = []
    for tile in tiles:
        below = _blank(height - tile.shape[0], tile.shape[1])
        parts += [np.vstack([tile, below]), _blank(height, _GAP)]
    return np.hstack(parts[:-1])


def _padded(row: Image, width: int) -> Image:
    """Add margins to a row and fill it up to `width`."""
    sheet = _blank(row.shape[0] + 8, width)
    sheet[: row.shape[0], _MARGIN : _MARGIN + row.shape[1]] = row
    return sheet
