"""Stores fetched pictures in a folder, measures them, and shows them if requested."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

from anytraverse.picture_size import picture_size

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
        size = picture_size(content)
        measured = "not a picture" if size is None else f"{size[0]} x {size[1]} pixels"
        shown = "" if not self._show or _open(path) else "; no viewer is found here: open it by hand"
        return f"{path} ({measured}, {len(content)} bytes{shown})"


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
