"""Draws and encodes pictures of judged frames: panels, thumbnails for a radio, and frames as PNG."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from msgspec.structs import replace

from anytraverse.assessment import Assessment, Map
from anytraverse.decoding import decode
from anytraverse.frame import Image, is_image
from anytraverse.regions import Region
from companion.vision.messages import LARGEST_JPEG, LARGEST_PNG, Draw, Drawn, Encode, Encoded
from companion.vision.video_picture import video_picture
from companion.wire.ids import State

if TYPE_CHECKING:
    from anytraverse.drawing import Colour

log = logging.getLogger(__name__)


LIMIT = 1500
"""Bytes of a thumbnail: 19 short MAVLink frames, a second or two on a radio."""
WIDTHS = (160, 128, 96)
"""Pixels, tried in this order: a narrower picture shows more than one of poor JPEG quality."""
FAIR = 25
"""JPEG quality below which a narrower picture is tried."""
_FINEST, _COARSEST = 90, 5


def thumbnail(seen: Assessment, region: Region, limit: int = LIMIT) -> bytes:
    """Encode a JPEG of at most `limit` bytes. White: the ROI. Yellow: its worst tile, if it looks unknown.

    Takes the greatest width at which quality `FAIR` fits, else the smallest. Raises ValueError when even that
    is too long, ImportError without OpenCV.
    """
    for width in WIDTHS:
        coarsest = _COARSEST if width == WIDTHS[-1] else FAIR
        found = _finest(_marked(seen, region, width), coarsest, limit)
        if found is not None:
            return found
    raise ValueError(f"no picture fits {limit} bytes")


def _marked(seen: Assessment, region: Region, width: int) -> Image:
    from anytraverse.drawing import INK, PAPER, YELLOW, fitted
    from anytraverse.judged_picture import marked_box

    picture = fitted(seen.frame.image, width)
    _frame(picture, region, PAPER)
    if (marked := marked_box(seen)) is not None:
        _frame(picture, marked, INK, around=2)
        _frame(picture, marked, YELLOW, around=1)
    return picture


def _frame(picture: Image, region: Region, colour: Colour, around: int = 0) -> None:
    """Draw a line one pixel wide, `around` pixels outside of a region."""
    import cv2

    from anytraverse.drawing import corner_pixels

    outwards = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], np.int32)
    corners = corner_pixels(picture, region) + around * outwards
    cv2.polylines(picture, [corners], True, colour, 1)  # noqa: FBT003


def _finest(picture: Image, coarsest: int, limit: int) -> bytes | None:
    """Encode at the best JPEG quality that fits, found by bisection; None when not even `coarsest` fits."""
    best = _encoded(picture, coarsest, smallest=True)
    if len(best) > limit:
        return None
    low, high = coarsest, _FINEST
    while low < high:
        middle = (low + high + 1) // 2
        tried = _encoded(picture, middle, smallest=True)
        if len(tried) <= limit:
            low, best = middle, tried
        else:
            high = middle - 1
    return best


def _encoded(picture: Image, quality: int, *, smallest: bool = False) -> bytes:
    """Encode as JPEG. smallest: with codes made for this picture, which takes longer. Raises ValueError."""
    import cv2

    options = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_OPTIMIZE, int(smallest)]
    # This conversion, unlike a reversed view, lets other threads run.
    done, encoded = cv2.imencode(".jpg", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), options)
    if not done:
        raise ValueError("the picture could not be encoded")
    return encoded.tobytes()


COLOURS = {
    State.STARTING: (110, 118, 129),
    State.OK: (0, 158, 115),
    State.CALLING: (230, 159, 0),
    State.HOLDING: (86, 180, 233),
    State.BLOCKED: (213, 94, 0),
    State.FAULT: (160, 30, 30),
    State.OFF: (110, 118, 129),
}
"""Of the bar above a picture, by the state."""
RECORDED_QUALITY = 85
"""JPEG quality of recorded frames."""
RECORDED_MAP = 96
"""Pixels: the greatest width of a recorded map."""
_QUALITY = 90
_RAW_QUALITY = 85
_VIDEO_QUALITY = 80


def drawn(request: Draw, seen: Assessment, region: Region) -> Drawn:
    """Make all requested pictures. One that fails is left out: a missing picture must not become a fault."""

    def made(what: str, draw: Callable[[], bytes]) -> bytes:
        try:
            return draw()
        except Exception as error:  # OpenCV may raise anything
            log.warning("no %s of %s: %r", what, request.title, error)
            return b""

    if request.video is not None:
        shown = seen, region, request.title, COLOURS[request.state], request.video
        video = made("video", lambda: _encoded(video_picture(*shown), _VIDEO_QUALITY))
        return Drawn(request.number, request.frame_id, request.title, panel=video)
    return Drawn(
        request.number,
        request.frame_id,
        request.title,
        panel=made("picture", lambda: panel(seen, request.state, request.title, region)),
        thumbnail=made("thumbnail", lambda: thumbnail(seen, region)) if request.store else b"",
        png=made("copy", lambda: to_png(seen.frame.image)) if request.store else b"",
        raw=made("unmarked picture", lambda: unmarked(seen.frame.image)) if request.store else b"",
        stored=request.store,
    )


def panel(seen: Assessment, state: State, title: str, region: Region) -> bytes:
    """Draw the frame with its maps, title and figures, as JPEG. Raises ValueError, ImportError."""
    from anytraverse.judged_picture import draw_state

    return _encoded(draw_state(seen.frame.image, seen, title, COLOURS[state], region=region), _QUALITY)


def unmarked(image: Image) -> bytes:
    """Encode a frame as JPEG without a mark, at most as wide as a panel. Raises ValueError, ImportError."""
    from anytraverse.drawing import fitted
    from anytraverse.judged_picture import STATE_WIDTH

    return _encoded(fitted(image, min(STATE_WIDTH, image.shape[1])), _RAW_QUALITY, smallest=True)


def encoded(request: Encode, seen: Assessment | None) -> Encoded:
    """Encode a frame and its maps for the recording. seen: None for a frame that is gone."""
    left_out = Encoded(request.number, request.frame_id)
    if seen is None:
        return left_out
    try:
        picture = _encoded(seen.frame.image, RECORDED_QUALITY)
        if len(picture) > LARGEST_JPEG:
            raise ValueError(f"{len(picture)} bytes, at most {LARGEST_JPEG} are recorded")
        if seen.maps is None:
            return replace(left_out, picture=picture)
        maps = (seen.maps.signed + 1.0) / 2.0, seen.maps.uncertainty
        traversability, uncertainty = map(_grey, maps)
    except Exception as error:  # OpenCV may raise anything
        log.warning("frame %d is not recorded: %r", request.frame_id, error)
        return left_out
    return replace(left_out, picture=picture, traversability=traversability, uncertainty=uncertainty)


def _grey(values: Map) -> bytes:
    """Encode a map of values in [0, 1] as a grey PNG of 8 bits. Raises ValueError."""
    import cv2

    height, width = values.shape
    if width > RECORDED_MAP:
        size = RECORDED_MAP, max(1, round(height * RECORDED_MAP / width))
        values = np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_AREA), np.float32)
    done, png = cv2.imencode(".png", np.rint(values * 255.0).astype(np.uint8))
    if not done:
        raise ValueError("the map could not be encoded")
    return png.tobytes()


def to_png(image: Image) -> bytes:
    """Encode a frame as PNG.

    Raises ValueError for an image that is not RGB or too large to be stored, ImportError without OpenCV.
    """
    import cv2

    if not is_image(image):
        raise ValueError("not an RGB picture of 8 bits a channel")
    done, encoded = cv2.imencode(".png", image[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 1])
    if not done:
        raise ValueError("the picture cannot be encoded")
    if encoded.nbytes > LARGEST_PNG:
        raise ValueError(f"{encoded.nbytes} bytes, at most {LARGEST_PNG} are kept: set a smaller picture")
    return encoded.tobytes()


def from_png(content: bytes) -> Image:
    """Decode what `to_png` encoded. Raises ValueError for no picture or one too large, ImportError."""
    picture = decode(content)
    if picture is None:
        raise ValueError("the picture is torn")
    return np.ascontiguousarray(picture[..., ::-1], np.uint8)
