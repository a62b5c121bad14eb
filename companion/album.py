"""Pictures of the moments that a person may want to look at later: calls, answers, holds."""

from __future__ import annotations

import contextlib
import logging
import re
from collections.abc import Callable
from pathlib import Path

from anytraverse.assessment import Assessment
from anytraverse.regions import Region
from companion.durable import write_whole
from companion.wire.ids import State

log = logging.getLogger(__name__)

_COLOURS = {
    State.STARTING: (110, 118, 129),
    State.OK: (0, 158, 115),
    State.CALLING: (230, 159, 0),
    State.HOLDING: (86, 180, 233),
    State.BLOCKED: (213, 94, 0),
    State.FAULT: (160, 30, 30),
    State.OFF: (110, 118, 129),
}


class Album:
    """A folder of at most `keep` pictures; the oldest goes. A picture that cannot be written is no fault."""

    def __init__(self, folder: Path, keep: int, region: Callable[[], Region]) -> None:
        """region: asked for the region of interest in force."""
        self._folder = folder
        self._keep = keep
        self._region = region
        self._count = max(map(_number, self._pictures()), default=0)
        for torn in folder.glob(".[0-9]*.part"):
            with contextlib.suppress(OSError):
                torn.unlink()

    def keep(self, seen: Assessment, state: State, title: str) -> str:
        """Draw and store a judged frame; the file's name, or "" when it could not be written."""
        if self._keep < 1:
            return ""
        try:
            return self._write(seen, state, title)
        except Exception as error:  # whatever the drawing raises, a picture is worth no fault
            log.warning("no picture of %s: %r", title, error)
            return ""

    def path(self, name: str) -> Path:
        """Where a picture lies."""
        return self._folder / name

    def _write(self, seen: Assessment, state: State, title: str) -> str:
        import cv2

        from anytraverse.panel import draw_state

        tile = draw_state(seen.frame.image, seen, title, _COLOURS[state], region=self._region())
        done, encoded = cv2.imencode(".jpg", tile[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 90])
        if not done:
            raise ValueError("the picture could not be encoded")
        self._count += 1
        slug = re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")[:40]
        name = f"{self._count:05d}-{slug}.jpg"
        write_whole(self._folder / name, encoded.tobytes())
        for old in self._pictures()[: -self._keep]:
            old.unlink(missing_ok=True)
        return name

    def _pictures(self) -> list[Path]:
        """The oldest first, also beyond 99,999."""
        return sorted((path for path in self._folder.glob("[0-9]*-*.jpg") if _number(path)), key=_number)


def _number(path: Path) -> int:
    number = path.name.partition("-")[0]
    return int(number) if number.isdecimal() else 0
