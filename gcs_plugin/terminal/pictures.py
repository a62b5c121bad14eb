"""Stores fetched pictures in a folder, measures them, and shows them if requested."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

_FRAME_HEADERS = {0xC0, 0xC1, 0xC2}  # JPEG markers SOF0 to SOF2
_VIEWERS = ("xdg-open", "open")


class Pictures:
    """Writes pictures to `folder`. show: open each with the desktop's viewer."""

    def __init__(self, folder: Path, *, show: bool = False) -> None:
        self._folder = folder
        self._show = show

    def keep(self, name: str, content: bytes) -> str:
        """Write a picture; return its path and size as a text for a person. Raises OSError."""
        self._folder.mkdir(parents=True, exist_ok=True)
        path = self._folder / name
        path.write_bytes(content)
        size = jpeg_size(content)
        measured = "not a JPEG" if size is None else f"{size[0]} x {size[1]} pixels"
        shown = "" if not self._show or _open(path) else "; no viewer is found here: open it by hand"
        return f"{path} ({measured}, {len(content)} bytes{shown})"


def jpeg_size(content: bytes) -> tuple[int, int] | None:
    """Read width and height in pixels from a JPEG's frame header (ITU-T T.81, B.2.2); None without one."""
    if content[:2] != b"\xff\xd8":
        return None
    at = 2
    while at + 9 <= len(content) and content[at] == 0xFF:
        if content[at + 1] in _FRAME_HEADERS:
            height, width = content[at + 5 : at + 7], content[at + 7 : at + 9]
            return int.from_bytes(width, "big"), int.from_bytes(height, "big")
        at += 2 + int.from_bytes(content[at + 2 : at + 4], "big")
    return None


def _open(path: Path) -> bool:
    viewer = next((found for name in _VIEWERS if (found := shutil.which(name))), None)
    if viewer is None:
        return False
    try:
        quiet = subprocess.DEVNULL
        subprocess.Popen([viewer, str(path)], stdin=quiet, stdout=quiet, stderr=quiet, start_new_session=True)
    except OSError:
        return False
    return True
