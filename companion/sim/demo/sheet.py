"""Makes the contact sheet: the key frames of a demo with their maps and states."""

from __future__ import annotations

from pathlib import Path

_MOST = 24


def write_sheet(out: Path) -> Path | None:
    """Writes `contact-sheet.png` from the snapshots in `out`; returns its path, None when there are none."""
    import cv2
    import numpy as np

    from anytraverse.panel import contact_sheet

    pictures = sorted((out / "state" / "pictures").glob("[0-9]*.jpg"))[:_MOST]
    tiles = [
        np.asarray(image[..., ::-1], dtype=np.uint8)
        for path in pictures
        if (image := cv2.imread(str(path))) is not None
    ]
    if not tiles:
        return None
    sheet = contact_sheet(tiles, 4, "What the rover saw, and why it stopped")
    path = out / "contact-sheet.png"
    cv2.imwrite(str(path), sheet[..., ::-1])
    return path
