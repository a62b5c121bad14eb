"""Every document and payload of calls and holds is told to the byte as it was told before."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from anytraverse.operations import SetWord, Tap
from companion.observers.page.calls import shown_calls
from companion.pages.given import Answered, OwnAnswers
from companion.wire.answers import Answer
from companion.wire.delivery import Pending
from companion.wire.documents import read_state
from companion.wire.ids import TUNNEL_CALL, Motion, Policy
from tests.companion.daemon.rig import MANUAL, MakeRig, Rig
from tests.companion.daemon.test_files_of_calls import place, told
from tests.golden import compare

GOLDEN = Path(__file__).with_suffix(".json")


class Noted:
    """Notes what is told at each step of a drive."""

    def __init__(self, rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
        self.rig, self._monkeypatch = rig, monkeypatch
        self.steps: dict[str, Any] = {}
        self.begin()

    def begin(self) -> None:
        """A daemon began: its wall clock is that of the rig."""
        clock = self.rig.daemon.position.clock
        self._monkeypatch.setattr(clock, "_wall", lambda: 1.79e9 + self.rig.clock.now)
        self._payloads = len(self.rig.stage.tunnels(TUNNEL_CALL))

    def note(self, step: str) -> None:
        rig = self.rig
        state = told(rig, "/state.json")
        files = sorted((rig.folder / "calls").glob("*.json"), reverse=True)
        records = {path.stem: path.read_text() for path in files}
        payloads = rig.stage.tunnels(TUNNEL_CALL)
        fresh, self._payloads = payloads[self._payloads :], len(payloads)
        rows = rig.journal._database.rows("SELECT * FROM calls ORDER BY number")
        saved = rig.journal.load_supervision() or {}
        self.steps[step] = {
            "open": json.dumps(state["open"]),
            "reasons": json.dumps(state["reasons"]),
            "records": records,
            "payloads": [payload.hex() for payload in fresh],
            "journal": [list(row) for row in rows],
            "saved": json.dumps({name: saved[name] for name in ("call", "hold") if name in saved}),
            "page": self._page(state, [json.loads(one) for one in records.values()]),
        }

    def _page(self, state: dict[str, Any], records: list[dict[str, Any]]) -> Any:
        pending = Pending(0, Answer(1, Motion.GO, (SetWord("drum", 1.0),), 8), 0.0)
        words = dict(read_state(json.dumps(state).encode()).words)
        own = {1: OwnAnswers([Answered(pending, 1.79e9, words)])}
        shown = shown_calls(state, 1000.0, records, lambda path: f"{path}?v=1", own)
        alone = shown_calls({}, 1000.0, records, lambda _path: "", {})
        return json.loads(json.dumps([shown, alone]))


@pytest.mark.slow
@pytest.mark.parametrize("pictures", [0, 3], ids=["without pictures", "with pictures"])
def test_what_is_told_of_a_drive(make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch, pictures: int) -> None:
    rig = make_rig(pictures=pictures)
    noted = Noted(rig, monkeypatch)
    noted.note("nothing")
    if pictures:
        place(rig)
    rig.see(3.0, "drum")
    noted.note("a call")
    rig.answer(1, Motion.STAY)
    rig.word(1, "trail", 1.0)
    rig.see(3.0, "drum")
    noted.note("a call that words do not cover")
    rig.restart()
    noted.begin()
    rig.see(1.0, "drum")
    noted.note("after a restart")
    call = rig.calls.call
    assert call is not None
    rig.answer(1, Motion.NONE, Tap(call.frame_id, (0.4, 0.6, 0.6, 0.8), "tümpel ü", -1.0), transaction=8)
    rig.see(3.0, "drum")
    noted.note("blocked by a word")
    rig.answer(1, Motion.GO, SetWord("drum", 1.0), transaction=9)
    rig.see(3.0, "drum")
    noted.note("answered")
    rig.see(5.0)
    rig.see(3.0, "rock")
    noted.note("a hold without a call")
    rig.stage.mode = MANUAL
    rig.see(3.0, "rock")
    noted.note("taken over")
    rig.stage.mode = 10
    rig.see(3.0)
    rig.see(4.0, scene=80)
    noted.note("a new place")
    rig.answer(rig.calls.current_id, Motion.GO, transaction=10)
    rig.see(3.0, scene=80)
    noted.note("accepted")
    compare(GOLDEN.with_stem(f"golden_calls_{pictures}"), noted.steps)


@pytest.mark.slow
def test_what_is_told_of_faults_and_of_a_call_that_passes(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = make_rig(Policy.REPORT, pictures=3)
    noted = Noted(rig, monkeypatch)
    rig.stage.send(mavlink.MAVLink_system_time_message(1_790_000_000_000_000, 0), (1, 1))
    rig.see(2.0, "drum", scene=80)
    noted.note("a thing in a new place")
    rig.wait(4.0)
    noted.note("no frames")
    rig.see(12.0)
    noted.note("passed")
    compare(GOLDEN.with_stem("golden_calls_report"), noted.steps)
