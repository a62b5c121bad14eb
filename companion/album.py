"""Pictures of the moments that a person may want to look at later: calls, answers, holds."""

from __future__ import annotations

import contextlib
import re
from pathlib import Path

from anytraverse.assessment import Assessment
from anytraverse.regions import Region
from companion.durable import write_whole
from companion.wire.ids import State

_COLOURS = {
    State.STARTING: (110, 118, 129),
    State.OK: (0, 158, 115),
    State.CALLING: (230, 159, 0),
    State.HOLDING: (86, 180, 233),
    State.BLOCKED: (213, 94, 0),
    State.FAULT: (160, 30, 30),
    State.OFF: (110, 118, 129),
}


def draw(seen: Assessment, state: State, title: str, region: Region) -> bytes:
    """A judged frame as the album's JPEG. Raises ValueError, ImportError without OpenCV."""
    import cv2

    from anytraverse.panel import draw_state

    tile = draw_state(seen.frame.image, seen, title, _COLOURS[state], region=region)
    done, encoded = cv2.imencode(".jpg", tile[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 90])
    if not done:
        raise ValueError("the picture could not be encoded")
    return encoded.tobytes()


class Album:
    """A folder of at most `keep` pictures; the oldest goes."""

    def __init__(self, folder: Path, keep: int) -> None:
        self._folder = folder
        self._keep = keep
        self._count = max(map(_number, self._pictures()), default=0)
        for torn in folder.glob(".[0-9]*.part"):
            with contextlib.suppress(OSError):
                torn.unlink()

    @property
    def wanted(self) -> bool:
        """Whether it keeps any picture at all."""
        return self._keep > 0

    def add(self, picture: bytes, title: str) -> Path:
        """Store a JPEG that `draw` made; where it lies. Raises OSError."""
        self._count += 1
        slug = re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")[:40]
        path = self._folder / f"{self._count:05d}-{slug}.jpg"
        write_whole(path, picture)
        for old in self._pictures()[: -self._keep]:
            old.unlink(missing_ok=True)
        return path

    def _pictures(self) -> list[Path]:
        """The oldest first, also beyond 99,999."""
        return sorted((path for path in self._folder.glob("[0-9]*-*.jpg") if _number(path)), key=_number)


def _number(path: Path) -> int:
    number = path.name.partition("-")[0]
    return int(number) if number.isdecimal() else 0
