"""Makes the contact sheet: the key frames of a demo, each call's as it was seen and as it was judged."""

from __future__ import annotations

import re
from pathlib import Path

from anytraverse.frame import Image

_MOST = 24
_COLUMNS = 4
_OF_A_CALL = re.compile(r"[0-9]+-([ch])([0-9]+)-")


def write_sheet(out: Path) -> Path | None:
    """Writes `contact-sheet.png` from the snapshots in `out`; returns its path, None when there are none.

    A call or hold begins a row: what it saw, beside it the judgement, then what followed.
    """
    import cv2
    import numpy as np

    from anytraverse.judged_picture import draw_frame
    from anytraverse.panel import contact_sheet

    tiles: list[Image] = []
    shown: set[str] = set()
    for path in sorted((out / "state" / "pictures").glob("[0-9]*.jpg"))[:_MOST]:
        judged = _read(path)
        if judged is None:
            continue
        named = _OF_A_CALL.match(path.name)
        if named is not None and named[2] not in shown:
            shown.add(named[2])
            raw = _read(out / "state" / "calls" / f"{named[2]}-raw.jpg")
            if raw is not None:
                tiles += [np.full_like(judged, 255)] * (-len(tiles) % _COLUMNS)
                tiles.append(
                    draw_frame(raw, f"{named[1].upper()}{named[2]} what it saw", width=judged.shape[1])
                )
        tiles.append(judged)
    if not tiles:
        return None
    sheet = contact_sheet(tiles, _COLUMNS, "What the rover saw, how it judged that, and why it stopped")
    path = out / "contact-sheet.png"
    cv2.imwrite(str(path), sheet[..., ::-1])
    return path


def _read(path: Path) -> Image | None:
    import cv2
    import numpy as np

    image = cv2.imread(str(path))
    return None if image is None else np.asarray(image[..., ::-1], dtype=np.uint8)
