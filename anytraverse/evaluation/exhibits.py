"""Draws a frame for the page of an evaluation: the picture, how it was judged, and what of that is wrong."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.drawing import FAINT, GREEN, VERMILION, VIOLET, Colour, enlarged, fitted, hatching, tint
from anytraverse.evaluation.datasets import LabelledFrame
from anytraverse.evaluation.drivable import HALF
from anytraverse.evaluation.labels import LabelClasses
from anytraverse.evaluation.seeing import TimedMaps, stretched, stretched_mask
from anytraverse.frame import Image

WIDTH = 480
"""Pixels that a picture on the page is wide."""
_QUALITY = 82
_TINT = 0.55  # of a judgement's colour at most, so that things stay recognisable


class Exhibit(NamedTuple):
    """Holds three JPEG files: the picture; its judgement; and where labels and judgement differ."""

    picture: bytes
    judged: bytes
    compared: bytes


def draw(frame: LabelledFrame, seen: TimedMaps, classes: LabelClasses, drivable: Sequence[str]) -> Exhibit:
    """Draw a frame. Green is drivable; in `compared` vermilion is found and wrong, violet was missed."""
    picture = fitted(frame.image, WIDTH)
    height, width = picture.shape[:2]
    judged = picture.copy()
    signed = enlarged(seen.maps.signed, width, height)
    tint(judged, GREEN, signed.clip(0, 1) * _TINT)
    tint(judged, VERMILION, (-signed).clip(0, 1) * _TINT)
    unknown = enlarged(seen.maps.uncertainty, width, height) > HALF
    tint(judged, VIOLET, (unknown & hatching(height, width)) * _TINT)

    shape = frame.labels.shape
    truth, labelled = classes.mask(frame.labels, drivable), classes.labelled(frame.labels)
    found = stretched(seen.maps.traversability, shape) > HALF
    compared = picture.copy()
    marks: tuple[tuple[Colour, NDArray[np.bool_]], ...] = (
        (GREEN, labelled & truth & found),
        (VERMILION, labelled & ~truth & found),
        (VIOLET, labelled & truth & ~found),
        (FAINT, ~labelled),
    )
    for colour, where in marks:
        tint(compared, colour, stretched_mask(where, (height, width)) * _TINT)
    return Exhibit(*map(_jpeg, (picture, judged, compared)))


def _jpeg(picture: Image) -> bytes:
    stored = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
    done, data = cv2.imencode(".jpg", stored, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    if not done:
        raise OSError("a picture cannot be encoded as JPEG")
    return data.tobytes()
