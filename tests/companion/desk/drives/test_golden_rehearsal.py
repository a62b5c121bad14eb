"""A rehearsal tells its page of calls what it told before."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from companion.config import load_config
from companion.desk.drives.frames import open_drive
from companion.desk.drives.judge import DriveJudge
from companion.desk.drives.rehearsal import AskedCall, Rehearsal, Said
from companion.vision.warm_up import load_engine
from companion.wire.ids import Reasons
from tests.companion.desk.drives.test_rehearsal import drive
from tests.companion.link.payloads import CALL
from tests.golden import compare

__all__ = ["drive"]
pytestmark = pytest.mark.skipif(
    any(find_spec(name) is None for name in ("starlette", "uvicorn")), reason="starlette is not installed"
)


@pytest.mark.slow
def test_what_a_page_is_told(drive: Path) -> None:
    from companion.desk.drives.browser_desk import BrowserDesk

    config = load_config(str(drive.parent / "companion.toml"))
    judge = DriveJudge(config, load_engine(config, None)[0])
    found = Rehearsal(frames=4)
    desk = BrowserDesk(judge, ("grass", "gravel"), found, open_drive(str(drive), 10.0))
    size = 4
    for number in (1, 2, 3):
        data = replace(CALL, id=number, why="unknown 91%, over 85% calls" if number > 1 else "")
        embedding = np.zeros(size, np.float32)
        call = AskedCall(number, f"{number:03d}.jpg", 1.25 * number, data, embedding, b"raw", b"judged")
        found.calls.append(call)
        desk._asked[number] = 100.0 + number, 1.79e9 + number
        desk._nearest[number] = None
    found.calls[0].said = [
        Said("tap old drum: -1 0.1000 0.2000 0.3000 0.4000, go", "C1 closed", taken=True),
        Said("grass: 1, meadow: -1", "nothing changed", taken=False),
    ]
    found.calls[0].by_person = True
    found.calls[1].data = replace(CALL, id=2, reasons=Reasons.UNKNOWN_SCENE, worst_tile_box=None)
    desk._current = found.calls[2]
    made = json.loads(json.dumps(desk._made(4, "asking")))
    told = {name: made[name] for name in ("calls", "names", "words", "asked", "answered")}
    compare(Path(__file__).with_name("golden_rehearsal.json"), told)
