"""The console tells its page of calls what it told before."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from companion.wire import ids
from companion.wire.call_report import CallReport
from tests.gcs_plugin.console.test_console import BOX, TEXT, WALL, Desk, desk
from tests.golden import compare

__all__ = ["desk"]
GOLDEN = Path(__file__).with_name("golden_page.json")
GIVEN = {
    "at": WALL + 2.0,
    "sender": [254, 190],
    "motion": "go",
    "operations": ["gravel: 1", "tap old drum: -1 0.1 0.2 0.3 0.4"],
    "result": "applied",
    "text": "C7 closed: answered, thank you",
}
EARLIER: dict[int, dict[str, Any]] = {
    7: {
        "reasons": ["unknown_object"],
        "place": {"latitude": 47.1, "longitude": 8.2, "heading": 12.0},
        "nearest": {"call": 4, "similarity": 0.91, "words": {"drum": -1}, "picture": "/calls/4.jpg"},
        "raw": "/calls/7-raw.jpg",
        "picture": "/calls/7.jpg",
        "answers": [GIVEN],
    },
    4: {
        "reasons": ["unknown_scene", "unknown_object"],
        "why": "new place, .91 like C3, .94 needed",
        "place": {"latitude": 47.1, "longitude": 8.2, "heading": 12.0},
        "worst_tile_box": BOX,
        "drivable_share": 0.5,
        "similarity": 0.91,
        "picture": "/calls/4.jpg",
        "outcome": "taken_over",
        "closed": WALL - 100.0,
        "answers": [{**GIVEN, "at": None, "motion": "none"}],
    },
    3: {"reasons": ["blocked"], "roi_uncertainty": 0.4, "worst_tile": 0.7, "outcome": None, "closed": None},
    2: {"outcome": "switched_off", "place": {}, "words": "grün: 1"},
}


def test_what_a_page_is_told_of_calls(desk: Desk) -> None:
    steps = {}

    def note(step: str) -> None:
        steps[step] = json.loads(json.dumps(desk.rover()["calls"]))

    for number, told in EARLIER.items():
        desk.files[f"{number}.json"] = json.dumps({"id": number, **told}).encode()
        desk.files.setdefault(f"{number}.jpg", desk.files["7.jpg"])
    desk.until(lambda: bool(desk.rover()["words_known"]))
    desk.post("fetch", what="calls")
    desk.until(lambda: desk.rover()["earlier"] == "known")
    desk.run(20.0)
    note("earlier calls")
    desk.call = replace(desk.call, latitude=47.3, longitude=8.5, heading=90.0, age_s=2, id=9, picture="")
    desk.announce()
    desk.run(5.0)
    desk.link.link.alerts.announce(replace(desk.call, stage=ids.Stage.CLEAR), TEXT, desk.link.now)
    desk.run(2.0)
    note("a call that is clear")
    desk.post(
        "answer", call=9, motion="go", changes=[{"tap": "drum", "weight": -1, "box": BOX, "frame": 4711}]
    )
    desk.until(lambda: bool(desk.requests()))
    desk.acknowledge(ids.Result.APPLIED, ids.Stage.ANSWERED, "C9 blocked by drum: waiting")
    desk.run(2.0)
    note("answered from here")
    desk.link.link.set_state(ids.State.OK, 0, ids.Policy.HOLD)
    closed = replace(desk.call, stage=ids.Stage.CLOSED, outcome=ids.Outcome.ANSWERED, holding=False)
    desk.link.link.alerts.announce(closed, "C9 closed: answered, thank you", desk.link.now)
    desk.run(6.0)
    note("closed")
    compare(GOLDEN, steps)


@pytest.mark.parametrize("kind", ["hold", "test", "new place"])
def test_what_a_page_is_told_of_others(desk: Desk, kind: str, thing_call: CallReport) -> None:
    others = {
        "hold": replace(desk.call, kind=ids.Kind.HOLD, reasons=ids.Reasons.BLOCKED, roi=None),
        "test": replace(desk.call, test=True, reasons=ids.Reasons.NONE, worst_tile_box=None, holding=False),
        "new place": replace(thing_call, reasons=ids.Reasons.UNKNOWN_SCENE, drivable_share=None),
    }
    desk.call = others[kind]
    desk.link.link.set_state(ids.State.CALLING, 7, ids.Policy.HOLD)
    desk.link.link.alerts.announce(
        desk.call, "C7 new place, .81 like a known one, .85 needed: go/word", desk.link.now
    )
    desk.run(6.0)
    told = {kind: json.loads(json.dumps(desk.rover()["calls"]))}
    compare(GOLDEN.with_stem(f"golden_page_{kind.replace(' ', '_')}"), told)
