"""Draws the picture of the video: the frame under a light tint, with what a call is about and what to do."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from anytraverse.assessment import Assessment
from anytraverse.frame import Image
from anytraverse.regions import Region
from companion.config.video import video_size
from companion.vision.messages import VideoMarks

if TYPE_CHECKING:
    from anytraverse.drawing import Colour

_BLUE = (90, 200, 255)
_BAR = 30
"""Pixels of the bars above and below. They lie on the picture: a tap's place is a share of the frame."""
_OPACITY = 0.8
_SIZE = 17


def video_picture(seen: Assessment, region: Region, title: str, colour: Colour, marks: VideoMarks) -> Image:
    """Draw a picture of `video_size`. White: the ROI. Yellow: what a call is about. Blue: what was tapped.

    Raises ImportError without OpenCV.
    """
    from anytraverse.drawing import INK, YELLOW, fitted, outline, readable_on, shortened, write
    from anytraverse.judged_picture import draw_judgement

    height, width = video_size(*seen.frame.image.shape[:2])
    picture = fitted(seen.frame.image, width)[:height]
    draw_judgement(picture, seen, region)
    if marks.place is not None:
        outline(picture, marks.place, YELLOW, 3)
    for tap in marks.taps:
        outline(picture, tap, _BLUE, 3)
    for text, bar, fill in ((title, picture[:_BAR], colour), (marks.note, picture[-_BAR:], INK)):
        if text:
            bar[:] = (bar * (1 - _OPACITY) + np.asarray(fill) * _OPACITY).round()
            line = shortened(text, width - 20, _SIZE, bold=True)
            write(bar, line, (10, 21), _SIZE, readable_on(fill), bold=True)
    return picture
