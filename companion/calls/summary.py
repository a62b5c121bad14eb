"""Makes the summary of a frame, and the report and text of a call or hold. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from anytraverse.assessment import CORRIDOR, NAMED_MEAN, NAMED_TILE, ROI_MEAN, WORST_TILE, Assessment, Reason
from anytraverse.ground import RELIABLE, GroundRegion
from anytraverse.history import Place
from anytraverse.light import light_name
from anytraverse.preferences import Preferences
from anytraverse.regions import Box, Region
from companion.calls.decisions import Call, CallState
from companion.calls.machine import OperatorCalls
from companion.guide.rules import NO_WAY
from companion.wire import texts
from companion.wire.call_figures import place_figures, thing_figures
from companion.wire.call_report import CallReport
from companion.wire.ids import Kind, Outcome, Policy, Reasons, Stage, State, words_hash
from companion.wire.packing import Fractions
from companion.wire.payloads import SECTORS, Summary

_FLAGS = {
    Reason.UNKNOWN_SCENE: Reasons.UNKNOWN_SCENE,
    Reason.UNKNOWN_OBJECT: Reasons.UNKNOWN_OBJECT,
    Reason.BLOCKED: Reasons.BLOCKED,
    Reason.FAULT: Reasons.FAULT,
}


_PARTS = {WORST_TILE: "yellow frame", NAMED_TILE: "yellow frame", ROI_MEAN: "region", NAMED_MEAN: "region"}
"""Figure that calls for a thing -> the part of the picture that it is of."""


def flags(reasons: Iterable[Reason]) -> Reasons:
    """Convert reasons to the flags of the payloads."""
    found = Reasons.NONE
    for reason in reasons:
        found |= _FLAGS[reason]
    return found


def fractions(box: Box) -> Fractions:
    """Convert a box to the fractions of the payloads: left, top, right, bottom."""
    return box.left, box.top, box.right, box.bottom


def summary(
    seen: Assessment,
    sectors: Sequence[float | None],
    state: State,
    policy: Policy,
    current_id: int,
    view: int,
    now: float,
) -> Summary:
    """Make the summary of the newest frame. The link fills in `sequence` and `dropped`.

    sectors: drivable share of each image column; empty where it was not judged. view: field of view, degrees.
    """
    roi = seen.roi
    return Summary(
        state=state,
        policy=policy,
        reasons=flags(seen.reasons),
        sequence=0,
        current_id=current_id,
        frame_id=seen.frame.id,
        frame_age_ms=milliseconds(max(now - seen.frame.captured_at, seen.age)),
        latency_ms=milliseconds(seen.age),
        roi_traversability=roi.traversability if roi else None,
        roi_uncertainty=roi.uncertainty if roi else None,
        worst_tile=roi.worst_tile.uncertainty if roi else None,
        similarity=seen.similarity,
        field_of_view=view,
        words=words_hash(seen.words),
        dropped=0,
        sectors=tuple(sectors) if len(sectors) == SECTORS else (None,) * SECTORS,
    )


def milliseconds(seconds: float) -> int:
    """Convert seconds to whole milliseconds, clipped to the 16 bits of the payload."""
    return max(0, min(0xFFFF, round(seconds * 1000)))


def current_data(
    calls: OperatorCalls,
    words: Preferences,
    place: Place,
    picture: str,
    now: float,
    *,
    measured: bool = False,
) -> CallReport | None:
    """Return the report of the open call or hold, None when nothing is open. measured: with its distance."""
    if calls.current_id == 0:
        return None
    call, hold = calls.call, calls.hold
    seen = call.seen if call is not None else (hold and hold.seen) or calls.reason_filter.newest
    since = call.opened_at if call is not None else hold.started_at if hold is not None else now
    place = call.place if call is not None and call.place.latitude is not None else place
    reasons = calls.reasons(now) | (call.reasons if call is not None and not call.answered else set())
    told = call_data(
        seen,
        calls.numbers.judging.region,
        words,
        place,
        number=calls.current_id,
        kind=calls.kind,
        stage=calls.stage(),
        reasons=reasons,
        holding=hold is not None and hold.standing,
        frame_id=call.frame_id if call is not None else seen.frame.id if seen else 0,
        age=now - since,
        picture=picture,
    )
    ground = calls.numbers.judging.metres if measured else None
    return told if seen is None or ground is None else replace(told, distance=_distance(told, seen, ground))


def _distance(told: CallReport, seen: Assessment, ground: GroundRegion) -> float | None:
    """Return how far ahead of the vehicle's front the ground under the call's box is; None above it."""
    box = told.worst_tile_box
    if box is None:
        return None
    camera = ground.camera.leaning(*(seen.frame.lean or (0.0, 0.0)))
    ahead = float(camera.to_ground(np.array([[(box[0] + box[2]) / 2, box[3]]]))[0, 0])
    return max(0.0, ahead - camera.front) if math.isfinite(ahead) and ahead <= RELIABLE else None


def recorded(call: Call) -> CallReport:
    """Return what is recorded of a call: also by which words it was judged, where and when it opened."""
    seen, place = call.seen, call.place
    told = call_data(
        seen,
        None,
        Preferences(),
        place,
        number=call.id,
        kind=Kind.CALL,
        outcome=call.outcome,
        reasons=call.reasons,
        frame_id=call.frame_id,
    )
    judged_by = None if seen is None else seen.words.format()
    return replace(told, judged_by=judged_by, time=place.time, attitude=place.attitude)


def call_data(
    seen: Assessment | None,
    region: Region | None,
    words: Preferences,
    place: Place,
    *,
    number: int,
    kind: Kind,
    reasons: Iterable[Reason],
    frame_id: int,
    stage: Stage = Stage.CLOSED,
    outcome: Outcome = Outcome.NONE,
    holding: bool = False,
    age: float = 0.0,
    picture: str = "",
) -> CallReport:
    """Make the report of a call or hold. Its figures are those of the frame `seen`."""
    roi, tile = (seen.roi, seen.tile) if seen is not None else (None, None)
    reasons = frozenset(reasons)
    place_asked = place_of(kind, seen) if seen is not None else None
    return CallReport(
        id=number,
        kind=kind,
        stage=stage,
        outcome=outcome,
        reasons=flags(reasons),
        holding=holding,
        why=why(seen, reasons),
        frame_id=frame_id,
        age_s=max(0, round(age)),
        roi=fractions(region.bounds) if region is not None else None,
        worst_tile_box=fractions(place_asked) if place_asked is not None else None,
        roi_uncertainty=roi.uncertainty if roi else None,
        worst_tile=tile.uncertainty if tile else None,
        drivable_share=roi.drivable_share if roi else None,
        similarity=seen.similarity if seen is not None else None,
        latitude=place.latitude,
        longitude=place.longitude,
        heading=place.heading,
        word_count=len(words),
        words=words_hash(words),
        picture=picture,
    )


def place_of(kind: Kind, seen: Assessment) -> Box | None:
    """Return the box that a call or hold asks about, None without one.

    A hold names the worst tile's box only where a tile is bad. Otherwise an operator who taps in that box
    would teach a word for ordinary ground.
    """
    points = seen.tile is not None and (kind is Kind.CALL or _has_bad_tile(seen))
    return seen.tile.shown if seen.tile is not None and points else None


def _has_bad_tile(seen: Assessment) -> bool:
    return any(finding.figure in (WORST_TILE, NAMED_TILE) for finding in seen.bad)


def current_text(calls: OperatorCalls, silent: list[str], now: float) -> str:
    """Return the text for people of the open call or hold, "" without one. silent: as for `fault_name`."""
    number, kind, stage = calls.current_id, calls.kind, calls.stage()
    reasons = calls.reasons(now)
    newest = calls.reason_filter.newest
    if number == 0:
        return ""
    if calls.hold is not None and calls.hold.failed:
        return texts.hold_failed(kind, number)
    waits_for_faults = calls.go_at is not None and bool(calls.reason_filter.standing_faults(now))
    if Reason.FAULT in reasons or waits_for_faults:
        return texts.fault(number, fault_name(newest, silent), kind)
    if stage is Stage.CLEAR and calls.hold is not None and calls.holding.mission_ended:
        return texts.mission_over(kind, number, calls.monitor.newest.mode_name(calls.hold.mode_before))
    if stage is Stage.CLEAR:
        return (texts.room if calls.reason_filter.goes_round(now) else texts.clear)(kind, number)
    call = calls.call
    guides = calls.policy is Policy.GUIDE
    if call is not None and not call.answered and stage is not Stage.ANSWERED:
        text = _unanswered_text(number, call.reasons, call.seen, tried=call.state is CallState.NOT_COVERED)
        return texts.no_room(text) if guides and Reason.UNKNOWN_OBJECT in call.reasons else text
    if calls.reason_filter.no_way not in ("", NO_WAY):
        return texts.cannot_guide(kind, number, calls.reason_filter.no_way)
    if Reason.BLOCKED in reasons:
        text = _blocked_text(calls, number, kind)
        return texts.no_room(text) if guides else text
    if calls.go_at is not None:
        return texts.waiting_for_view(kind, number)
    return (texts.answered_waiting if stage is Stage.ANSWERED else texts.holding)(kind, number)


def _blocked_text(calls: OperatorCalls, number: int, kind: Kind) -> str:
    newest = calls.reason_filter.newest
    blocked = newest is not None and Reason.BLOCKED in newest.reasons
    if words := [] if blocked else calls.reason_filter.things.words:
        return texts.blocked_by(number, words[-1], kind)
    shown = calls.hold.seen if calls.hold is not None and not blocked else None
    return blocked_text(shown or newest, number, kind)


def blocked_text(seen: Assessment | None, number: int, kind: Kind) -> str:
    """Return the text that says what blocks the way: a named thing, no corridor, or too little ground."""
    if seen is None or seen.roi is None:
        return texts.blocked(number, None, kind)
    finding = seen.finding(Reason.BLOCKED)
    figure = finding.figure if finding is not None else ""
    if figure == NAMED_TILE and seen.roi.named_tile is not None:
        return texts.blocked_by(number, list(seen.words)[seen.roi.named_tile.word], kind)
    if figure == CORRIDOR:
        return texts.no_way(number, kind)
    return texts.blocked(number, seen.roi.drivable_share, kind)


def fault_name(newest: Assessment | None, silent: list[str]) -> str:
    """Name the fault in a few words: the first silent task, or the newest frame's fault.

    silent: tasks without a sign of life.
    """
    if silent:
        return silent[0]
    finding = newest.finding(Reason.FAULT) if newest is not None else None
    return finding.figure if finding is not None else "no fresh frame"


def why(seen: Assessment | None, reasons: Iterable[Reason]) -> str:
    """Word the figures that call, and what they lack, of these reasons: "" where none is known."""
    found, light = [], _light(seen)
    place, thing = _place_figures(seen), _thing_figures(seen)
    if Reason.UNKNOWN_SCENE in reasons and place[0] is not None:
        found.append(place_figures(*place, light))
    if Reason.UNKNOWN_OBJECT in reasons and thing[0] is not None:
        found.append(thing_figures(*thing, light))
    return "; ".join(found)


def still_open_text(number: int, seen: Assessment, reasons: Iterable[Reason]) -> str:
    """Return the text that says that an answer's words do not cover what the call shows."""
    if Reason.UNKNOWN_OBJECT not in reasons:
        return texts.still_new(number, *_place_figures(seen)[:2])
    return texts.still_unknown(number, *_thing_figures(seen)[:2])


def _light(seen: Assessment | None) -> str:
    return light_name(seen.light) if seen is not None else ""


def _place_figures(seen: Assessment | None) -> tuple[float | None, float | None, int | None]:
    """Return the similarity to the known place that nearly matches, what it needs to match, and its call."""
    if seen is None:
        return None, None, None
    if seen.likeness is not None:
        return seen.likeness.similarity, seen.likeness.needed, seen.likeness.call_id
    scene = seen.finding(Reason.UNKNOWN_SCENE)
    return (None, None, None) if scene is None else (scene.value, scene.threshold, None)


def _thing_figures(seen: Assessment | None) -> tuple[float | None, float | None, str]:
    """Return how unknown a thing is, the threshold, and where: in the yellow frame, else in the region."""
    bad = seen.bad if seen is not None else ()
    found = {one.figure: one for one in bad if one.reason is Reason.UNKNOWN_OBJECT}
    for figure, of in _PARTS.items():
        if figure in found:
            return found[figure].value, found[figure].threshold, of
    return None, None, ""


def _unanswered_text(number: int, reasons: Iterable[Reason], seen: Assessment | None, *, tried: bool) -> str:
    reasons = frozenset(reasons)
    if tried and seen is not None:
        return still_open_text(number, seen, reasons)
    if Reason.UNKNOWN_OBJECT not in reasons:
        return texts.unknown_scene(number, *_place_figures(seen), _light(seen))
    if Reason.UNKNOWN_SCENE in reasons:
        return texts.unknown_both(number, *_thing_figures(seen)[:2])
    return texts.unknown_object(number, *_thing_figures(seen), _light(seen))
