"""Draws a judged frame for people: the judgement over the frame, its figures, and what the colours mean.

All public functions take RGB uint8. `draw_boxes` and `draw_judgement` draw in place; the others do not change
their arguments.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from anytraverse.assessment import NAMED_TILE, WORST_TILE, Assessment, Reason
from anytraverse.drawing import (
    FAINT,
    GREEN,
    INK,
    PAPER,
    VERMILION,
    VIOLET,
    YELLOW,
    Colour,
    Map,
    enlarged,
    fitted,
    hatching,
    outline,
    readable_on,
    shortened,
    text_width,
    tint,
    write,
)
from anytraverse.frame import Image
from anytraverse.regions import Box, Region

STATE_WIDTH = 480
"""Pixels that a picture with the state is wide by default."""
_UNSURE = 0.35  # uncertainty from which ground is hatched and a tile is outlined
_TINT = 0.25  # of the judgement's colours at most, so that things stay recognisable
_SCENE = 0.3  # share of the picture from which what is unknown is no single thing
_ON_INK: Colour = (233, 236, 239)
_LEGEND = (
    ("drivable", GREEN, "tint"),
    ("not drivable", VERMILION, "tint"),
    ("unknown", VIOLET, "stripes"),
    ("region of interest", PAPER, "frame"),
    ("look here", YELLOW, "frame"),
)


def draw_state(
    image: Image,
    assessment: Assessment,
    title: str,
    colour: Colour = GREEN,
    *,
    region: Region,
    note: str = "",
    width: int = STATE_WIDTH,
) -> Image:
    """Draw the judgement over the image, with a bar in the state's colour above, figures and a legend below.

    Green is drivable, vermilion is not, violet stripes are unknown. White is the ROI's outline. The yellow
    box is `marked_box`, in which nothing is tinted; a yellow line surrounds the thing that reaches into it.
    """
    picture = fitted(image, width)
    draw_judgement(picture, assessment, region)
    foot = _foot(width, note or figures(assessment))
    _draw_legend(foot, 8, 26)
    return np.vstack([_bar(width, title, colour), picture, foot])


def draw_judgement(picture: Image, assessment: Assessment, region: Region) -> None:
    """Draw tint, boxes and the thing's outline of `draw_state` into a picture of any size."""
    marked = marked_box(assessment)
    if (maps := assessment.maps) is not None:
        around = Reason.UNKNOWN_OBJECT in assessment.reasons
        draw_maps(picture, maps.signed, maps.uncertainty, marked, around=around)
    draw_boxes(picture, region, marked)


def draw_maps(picture: Image, signed: Map, uncertainty: Map, marked: Box | None, *, around: bool) -> None:
    """Tint a picture of any size by its maps, (h, w), but not in the box `marked`.

    around: outline the unknown thing that reaches into that box.
    """
    height, width = picture.shape[:2]
    signed, unsure = enlarged(signed, width, height), enlarged(uncertainty, width, height)
    untouched = np.s_[:0, :0] if marked is None else marked.slices(height, width)
    seen = picture[untouched].copy()
    outlines = _thing_around(unsure, untouched) if around else []
    tint(picture, GREEN, _TINT * signed.clip(0, 1))
    tint(picture, VERMILION, _TINT * (-signed).clip(0, 1))
    strength = ((unsure - _UNSURE) / (1 - _UNSURE)).clip(0, 1)
    tint(picture, VIOLET, strength * 0.8 * hatching(height, width))
    cv2.drawContours(picture, outlines, -1, (20, 20, 20), 4, cv2.LINE_AA)
    cv2.drawContours(picture, outlines, -1, YELLOW, 2, cv2.LINE_AA)
    picture[untouched] = seen


def draw_frame(image: Image, title: str, note: str = "", *, width: int = STATE_WIDTH) -> Image:
    """Draw the image as it is, with a bar above and a line below, to stand beside `draw_state` of it."""
    return np.vstack([_bar(width, title, FAINT), fitted(image, width), _foot(width, note)])


def _bar(width: int, title: str, colour: Colour) -> Image:
    bar = np.full((34, width, 3), colour, dtype=np.uint8)
    write(bar, shortened(title, width - 24, 16, bold=True), (12, 23), 16, readable_on(colour), bold=True)
    return bar


def _foot(width: int, text: str) -> Image:
    foot = np.full((30, width, 3), INK, dtype=np.uint8)
    write(foot, shortened(text, width - 16, 12), (8, 12), 12, _ON_INK)
    return foot


def draw_boxes(picture: Image, region: Region, marked: Box | None) -> None:
    """Outline the region of interest in white, and `marked` in yellow."""
    outline(picture, region, PAPER, 2)
    if marked is not None:
        outline(picture, marked, YELLOW, 2)


def _thing_around(unsure: Map, inside: tuple[slice, slice]) -> list[Any]:
    """Return the outline of the unknown thing that fills most of `inside`; none of one as large as a scene.

    Seams between known things, as along the horizon, are narrower than a thing and are left out.
    """
    narrow = np.ones((unsure.shape[1] // 40, unsure.shape[1] // 40), np.uint8)
    unknown = cv2.morphologyEx((unsure > _UNSURE).astype(np.uint8), cv2.MORPH_OPEN, narrow)
    _, parts = cv2.connectedComponents(unknown)
    counts = np.bincount(np.asarray(parts[inside]).ravel(), minlength=1)
    counts[0] = 0
    thing = (parts == counts.argmax()).astype(np.uint8)
    if not counts.any() or thing.mean() >= _SCENE:
        return []
    return list(cv2.findContours(thing, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)[0])


def _draw_legend(canvas: Image, x: int, baseline: int) -> None:
    """Write what the colours of `draw_state` mean from `x` on, in one line on a dark ground."""
    top, bottom = baseline - 9, baseline + 1
    for name, colour, kind in _LEGEND:
        swatch = canvas[top:bottom, x : x + 14]
        if kind == "frame":
            cv2.rectangle(canvas, (x, top), (x + 13, bottom - 1), colour, 2)
        elif kind == "stripes":
            swatch[:] = PAPER
            tint(swatch, colour, 0.8 * hatching(*swatch.shape[:2]))
        else:
            swatch[:] = colour
        write(canvas, name, (x + 19, baseline), 12, _ON_INK)
        x += 19 + text_width(name, 12) + 12


def marked_box(assessment: Assessment) -> Box | None:
    """Return the box to outline: that of the tile where it is bad, or something is unknown or nearly so.

    The gap of a corridor that is closed over known ground is not outlined: no thing is there to be named. In
    a new place where no tile is bad nothing is: the call is about the place.
    """
    roi, tile = assessment.roi, assessment.tile
    if roi is None or tile is None:
        return None
    if Reason.UNKNOWN_OBJECT in assessment.reasons:
        return tile.shown
    if any(finding.figure in (WORST_TILE, NAMED_TILE) for finding in assessment.bad):
        return tile.shown
    no_thing = tile is roi.corridor.gap or Reason.UNKNOWN_SCENE in assessment.reasons
    return tile.shown if tile.uncertainty > _UNSURE and not no_thing else None


def figures(assessment: Assessment) -> str:
    """Return the figures that a call tells, rounded as its texts round them; of a fault what is wrong."""
    faults = [finding.figure for finding in assessment.bad if finding.reason is Reason.FAULT]
    roi, tile = assessment.roi, assessment.tile
    if roi is None:
        return "; ".join(faults) or "not judged"
    parts = [*faults, f"{roi.uncertainty:.0%} unexplained"]
    if tile is not None:
        parts.append(f"worst place {tile.uncertainty:.0%}")
    if roi.drivable_share is not None:
        parts.append(f"{roi.drivable_share:.0%} of the known drivable")
    if assessment.similarity is not None:
        older = f" ({assessment.scene_age:.1f} s before)" if assessment.scene_age else ""
        parts.append(f"similarity {assessment.similarity:.2f}{older}")
    return "   ".join(parts)
