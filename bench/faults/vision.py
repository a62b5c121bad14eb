"""Rows of the vision process: hung, dead, or wrong in what it says."""

from __future__ import annotations

from bench.faults.row import BACK_WITHIN, HOLD_WITHIN, Row
from bench.faults.stages import stops
from bench.stopping.faults import BREAKABLE, FAINT, NO_MEMORY, WRONG_SHAPES
from bench.stopping.stage import RETURN_WITHIN
from companion.vision.measured_pace import BAD_FOR

_HELD = "held; vision is started again"

ROWS = (
    Row(
        "vision hung",
        "the perceiver never answers; 20 times",
        _HELD,
        stops(BREAKABLE["hung_perceiver"], 20, breakable=True),
        HOLD_WITHIN,
        BACK_WITHIN,
    ),
    Row(
        "vision hung in native code",
        "the same in native code that keeps the interpreter's lock; 20 times",
        _HELD,
        stops(BREAKABLE["vision_lock_hang"], 20, breakable=True),
        HOLD_WITHIN,
        BACK_WITHIN,
    ),
    Row(
        "vision segfault, again and again",
        "native code reads an invalid address with the first picture, until the rover stands",
        _HELD,
        stops(BREAKABLE["vision_segfault"], 5, breakable=True),
        HOLD_WITHIN,
        BACK_WITHIN,
    ),
    Row(
        "vision out of memory: killed",
        "SIGKILL with the first picture, as the kernel does when memory runs out, until the rover stands",
        _HELD,
        stops(BREAKABLE["vision_out_of_memory"], 5, breakable=True),
        HOLD_WITHIN,
        BACK_WITHIN,
    ),
    Row(
        "vision out of memory: refused",
        "the kernel gives the process no more memory (RLIMIT_AS), and each picture needs more",
        "held",
        stops(NO_MEMORY, 5, breakable=True),
        HOLD_WITHIN,
        BACK_WITHIN,
    ),
    Row(
        "frames judged too slowly",
        "each picture takes 0.45 s longer, so that two of them and a period exceed T; until the rover stands",
        "held after 5 s at most",
        stops(BREAKABLE["slow_frames"], 5, breakable=True),
        HOLD_WITHIN + BAD_FOR,
        RETURN_WITHIN,
    ),
    Row(
        "maps of NaN",
        "the perceiver's maps are NaN everywhere, or in one pixel",
        "held",
        stops({"all": BREAKABLE["nan_maps"], "one pixel": FAINT["nan_maps"]}, 3, breakable=True),
        HOLD_WITHIN,
        BACK_WITHIN,
    ),
    Row(
        "maps or embedding of a wrong shape",
        f"the perceiver delivers another shape or type: {', '.join(WRONG_SHAPES)}",
        "held, or called and held",
        stops(WRONG_SHAPES, 2, breakable=True),
        HOLD_WITHIN,
        BACK_WITHIN,
    ),
)
