"""Gives one payload of each kind, of the same call: docs/protocol.md shows them, and tests read them."""

from __future__ import annotations

from anytraverse.operations import SetWord, Tap
from companion.wire.answers import Acknowledgement, Answer
from companion.wire.call_report import CallReport
from companion.wire.ids import Kind, Motion, Outcome, Policy, Reasons, Result, Stage, State, words_hash
from companion.wire.parameters import ListOptions, Parameter, pack
from companion.wire.payloads import Summary

BEFORE = {"grass": 1.0, "dirt path": 1.0, "bush": -1.0}
BOX = (0.45, 0.62, 0.55, 0.78)
EXAMPLES: dict[str, Summary | CallReport | Answer | Acknowledgement] = {
    "summary": Summary(
        state=State.CALLING,
        policy=Policy.HOLD,
        reasons=Reasons.UNKNOWN_OBJECT,
        sequence=1207,
        current_id=7,
        frame_id=48213,
        frame_age_ms=140,
        latency_ms=96,
        roi_traversability=0.5821,
        roi_uncertainty=0.3804,
        worst_tile=0.9312,
        similarity=0.9127,
        field_of_view=69,
        words=words_hash(BEFORE),
        dropped=2,
        sectors=(*[None] * 2, *[1.0] * 5, 0.4, 0.0, 0.25, *[1.0] * 4, *[None] * 2),
    ),
    "call": CallReport(
        id=7,
        kind=Kind.CALL,
        stage=Stage.OPEN,
        outcome=Outcome.NONE,
        reasons=Reasons.UNKNOWN_OBJECT,
        holding=True,
        test=False,
        frame_id=48197,
        age_s=12,
        roi=(0.333, 0.6, 0.667, 0.95),
        worst_tile_box=BOX,
        roi_uncertainty=0.3804,
        worst_tile=0.9312,
        drivable_share=0.5821,
        similarity=0.9127,
        latitude=47.3769,
        longitude=-8.5417,
        heading=271.5,
        word_count=3,
        words=words_hash(BEFORE),
        picture="/calls/7.jpg",
    ),
    "answer": Answer(7, Motion.GO, (SetWord("gravel", 0.8), Tap(48197, BOX, "drum", -1.0)), 0x1F2E3D4C),
    "acknowledgement": Acknowledgement(
        transaction=0x1F2E3D4C,
        target=7,
        result=Result.APPLIED,
        stage=Stage.ANSWERED,
        outcome=Outcome.NONE,
        roi_uncertainty=0.0312,
        worst_tile=0.0744,
        reasons=Reasons.NONE,
        words=words_hash(BEFORE | {"gravel": 0.8, "drum": -1.0}),
        text="C7 go given: waiting for a clear view",
    ),
}

PARAMETER_FILE = pack(
    [Parameter("AT_W_BUSH", -1.0, -1.0, 1.0), Parameter("AT_W_DIRT", 1.0, -1.0, 1.0)],
    ListOptions(with_defaults=True),
    {"AT_W_DIRT": 0.5},
)
"""Two parameters, of which the second was set from 0.5 to 1."""
