"""Makes the contact sheet: the key frames of a demo, each call's as it was seen and as it was judged."""

from __future__ import annotations

import re
from pathlib import Path

from anytraverse.frame import Image

_MOST = 12
_OF_A_CALL = re.compile(r"[0-9]+-([ch])([0-9]+)-")


def write_sheet(out: Path) -> Path | None:
    """Writes `contact-sheet.png` from the snapshots in `out`; returns its path, None when there are none.

    Of each call and blocked hold it shows what the rover saw, and beside that how it judged it. Of a place
    that was known again it shows the judgement.
    """
    import cv2
    import numpy as np

    from anytraverse.judged_picture import draw_frame
    from anytraverse.panel import contact_sheet

    pairs: list[Image] = []
    shown: set[str] = set()
    for path in sorted((out / "state" / "pictures").glob("[0-9]*.jpg")):
        named = _OF_A_CALL.match(path.name)
        number = "" if named is None else named[2]
        judged = _read(path)
        if number in shown or path.stem.endswith("-drives-on") or judged is None or len(pairs) >= 2 * _MOST:
            continue
        raw = None if named is None else _read(out / "state" / "calls" / f"{number}-raw.jpg")
        if raw is None:
            pairs += [judged, np.full_like(judged, 255)]
        else:
            assert named is not None
            pairs += [
                draw_frame(raw, f"{named[1].upper()}{number} what it saw", width=judged.shape[1]),
                judged,
            ]
        shown |= {number} - {""}
    if not pairs:
        return None
    sheet = contact_sheet(pairs, 4, "What the rover saw, and beside it how it judged that")
    path = out / "contact-sheet.png"
    cv2.imwrite(str(path), sheet[..., ::-1])
    return path


def _read(path: Path) -> Image | None:
    import cv2
    import numpy as np

    image = cv2.imread(str(path)) if path.is_file() else None
    return None if image is None else np.asarray(image[..., ::-1], dtype=np.uint8)
