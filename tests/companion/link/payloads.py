"""A summary and a call, as a daemon hands them to its link."""

from dataclasses import replace

from companion.wire.call_report import CallReport
from companion.wire.ids import Kind, Outcome, Policy, Reasons, Stage, State
from companion.wire.payloads import Summary

SUMMARY = Summary(
    State.OK, Policy.REPORT, Reasons.NONE, 0, 0, 1, 50, 40, 0.5, 0.1, 0.2, 0.9, 60, 7, 0, (0.5,) * 16
)
CALL = CallReport(
    id=7,
    kind=Kind.CALL,
    stage=Stage.OPEN,
    outcome=Outcome.NONE,
    reasons=Reasons.UNKNOWN_OBJECT,
    holding=False,
    test=False,
    frame_id=40,
    age_s=0,
    roi=(0.3, 0.6, 0.7, 0.95),
    worst_tile_box=(0.4, 0.7, 0.5, 0.8),
    roi_uncertainty=0.38,
    worst_tile=0.9,
    drivable_share=0.5,
    similarity=0.9,
    latitude=47.3,
    longitude=8.5,
    heading=None,
    word_count=3,
    words=1,
    picture="calls/7.jpg",
)
LONG_CALL = replace(CALL, id=1, picture="a/long/name/of/a/picture/that/fills/the/frame/to/its/end.jpg")
