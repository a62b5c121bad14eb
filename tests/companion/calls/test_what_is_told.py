"""What the ground reads of the state: texts of at most 50 bytes, summary and call data."""

from __future__ import annotations

from dataclasses import replace

import pytest

from anytraverse.assessment import ROI_MEAN, Finding, Reason
from anytraverse.history import Likeness, Place
from anytraverse.preferences import Preferences
from anytraverse.regions import Box
from companion.calls.decisions import HoldShown
from companion.calls.faults import Fault
from companion.calls.summary import (
    call_data,
    current_data,
    current_text,
    flags,
    milliseconds,
    summary,
    why,
)
from companion.wire.call_report import CallReport
from companion.wire.ids import Kind, Motion, Outcome, Policy, Reasons, Stage, State, words_hash
from companion.wire.payloads import Summary
from tests.companion.calls.scenes import (
    ACROSS,
    AHEAD,
    AUTO,
    BROKEN,
    CLEAR,
    DRUM,
    ELSEWHERE,
    GNOME,
    HOLD,
    LOG,
    MANUAL,
    SLIVER,
    Scene,
    Thing,
    View,
)

SECTORS = (0.0, 0.5, 1.0, None) * 4
BARREL = View((Thing(ACROSS),))


def text(scene: Scene, *silent: str) -> str:
    """The text of what is open; it fits a STATUSTEXT that every ground station shows whole."""
    said = current_text(scene.calls, list(silent), scene.now)
    assert len(said.encode()) <= 50
    return said


def data(scene: Scene) -> CallReport:
    """The data of what is open, after the wire."""
    made = current_data(
        scene.calls, Preferences.of(scene.words), Place(51.5, -0.1, 359.99), "7.jpg", scene.now
    )
    assert made is not None
    return CallReport.unpack(made.pack())


def test_with_nothing_open_nothing_is_told(report: Scene) -> None:
    assert text(report) == ""
    words = Preferences.of(report.words)
    assert current_data(report.calls, words, Place(), "", report.now) is None


def test_a_call_for_a_thing_says_what_and_how_to_answer(report: Scene) -> None:
    report.run(1.0, DRUM)
    assert text(report) == "C1 unknown 95% in yellow frame, over 25% calls"


def test_a_call_for_a_place_says_so(report: Scene) -> None:
    report.run(1.0, ELSEWHERE)
    assert text(report) == "C1 new place, .50, .85 needed: go/stay/word"


def test_data_have_the_words_of_all_figures_which_the_payload_has_no_room_for(report: Scene) -> None:
    report.run(1.0, View((Thing(AHEAD),), turned=60.0))
    made = current_data(report.calls, Preferences.of(report.words), Place(), "", report.now)
    assert made is not None
    assert made.why == "new place, .50, .85 needed; unknown 95% in yellow frame, over 25% calls"
    assert CallReport.unpack(made.pack()).why == ""


def test_a_new_place_names_the_one_that_it_is_most_nearly(report: Scene) -> None:
    report.run(1.0, ELSEWHERE)
    call = report.calls.call
    assert call is not None
    assert call.seen is not None
    call.seen = replace(call.seen, likeness=Likeness(3, 0.914, 0.94))
    assert text(report) == "C1 new place, .91 like C3, .94 needed: go/word"


def test_a_mean_over_its_limit_is_told_as_the_regions(report: Scene) -> None:
    mean = Finding.above(Reason.UNKNOWN_OBJECT, ROI_MEAN, 0.42, 0.3, 0.03)
    report.show(CLEAR)
    seen = report.calls.reason_filter.newest
    assert seen is not None
    thing = {Reason.UNKNOWN_OBJECT}
    assert why(replace(seen, findings=(mean,)), thing) == "unknown 42% in region, over 30% calls"
    assert why(seen, {Reason.UNKNOWN_OBJECT, Reason.UNKNOWN_SCENE, Reason.BLOCKED}) == ""
    assert why(None, {Reason.UNKNOWN_SCENE}) == ""


def test_a_call_for_both_says_both(report: Scene) -> None:
    report.run(1.0, View((Thing(AHEAD),), turned=60.0))
    assert text(report) == "C1 new place, unknown 95%, over 25% calls: go/word"


def test_words_that_did_not_cover_are_told_with_the_figure(report: Scene) -> None:
    report.run(1.0, DRUM)
    report.answer(words={"puddle": -1.0})
    assert text(report) == "C1 stays open: unknown 95%, over 25% calls"


def test_the_largest_id_and_the_longest_fault_fit(report: Scene) -> None:
    report.calls.last_id = 0xFFFE
    report.run(1.0, View((Thing(AHEAD),), turned=60.0))
    assert text(report).startswith("C65535 new place, unknown 95%, over 25% calls")
    assert text(report) == text(report).strip()


def test_a_blocked_hold_says_blocked(blocked: Scene) -> None:
    assert text(blocked) == "H1 blocked by log: waiting"


def test_a_hold_before_a_named_thing_that_leaves_a_way_says_the_name(hold: Scene) -> None:
    hold.words[GNOME] = -1.0
    hold.run(1.0, View((Thing(SLIVER, mistaken=0.5),)))
    assert hold.held() == [{Reason.BLOCKED}]
    assert text(hold) == "H1 blocked by gnome: waiting"


def test_a_hold_whose_view_has_just_cleared_still_says_what_blocked_it(hold: Scene) -> None:
    hold.words[GNOME] = -1.0
    hold.run(1.0, View((Thing(SLIVER, mistaken=0.5),)))
    hold.show(CLEAR)
    assert text(hold) == "H1 blocked by gnome: waiting"


def test_a_hold_without_a_bad_tile_says_how_much_is_drivable_or_that_there_is_no_way() -> None:
    for top, said in ((0.0, "14% drivable"), (0.84, "no way through")):
        hold = Scene(Policy.HOLD, tile=None)
        hold.run(1.0, View((Thing(Box(0.0, top, 1.0, 0.9), "log"),)))
        assert text(hold).startswith("H1 blocked")
        assert said in text(hold)
        assert data(hold).worst_tile_box is None


def test_a_fault_outranks_what_the_call_asks(held: Scene) -> None:
    held.run(1.0, BROKEN)
    assert text(held) == "C1 FAULT attention maps are not finite"
    assert text(held, "camera silent") == "C1 FAULT camera silent"


def test_a_hold_for_want_of_frames_says_so(hold: Scene) -> None:
    hold.camera = False
    hold.run(2.0)
    assert text(hold) == "H1 FAULT no fresh frame"


def test_a_thing_that_walked_off_asks_clear_now_go(held: Scene) -> None:
    held.run(1.0, CLEAR)
    assert text(held) == "C1 clear now, go?"


def test_answered_words_ask_for_a_go_and_then_for_nothing_but_that(held: Scene) -> None:
    held.answer(words={"drum": 1.0})
    assert text(held) == "C1 answered, holding: go when ready"
    held.run(1.0)
    assert text(held) == "C1 clear now, go?"


def test_a_go_that_waits_says_what_for(hold: Scene) -> None:
    hold.run(1.0, BARREL)
    hold.go({"drum": -1.0})
    hold.run(1.0)
    assert text(hold) == "C1 blocked by drum: waiting"
    hold.show(CLEAR, CLEAR)
    assert text(hold) == "C1 blocked by drum: waiting"
    hold.show(*[CLEAR] * 5)
    assert text(hold) == "C1 go given: waiting for a clear view"


def test_a_go_that_waits_for_a_fault_names_it_though_a_human_drove_on_over_it(hold: Scene) -> None:
    hold.keep(hold.calls.fault_reported(Fault.COURSE, "drives backwards", hold.now))
    hold.run(2.0)
    hold.human(AUTO)
    hold.run(1.0, BARREL)
    hold.go({"drum": 1.0})
    hold.run(1.0)
    assert hold.calls.fault_accepted(hold.now)
    assert text(hold, "drives backwards") == "C2 FAULT drives backwards"


def test_a_hold_whose_reason_has_just_gone_only_says_that_it_holds(blocked: Scene) -> None:
    blocked.show(CLEAR, CLEAR)
    assert text(blocked) == "H1 holding"
    blocked.show(CLEAR, CLEAR, CLEAR)
    assert text(blocked) == "H1 clear now, go?"


def test_a_hold_that_failed_outranks_everything(hold: Scene) -> None:
    hold.autopilot.deaf = True
    hold.run(5.0, DRUM)
    assert text(hold) == "C1 HOLD FAILED: STOP BY HAND"


def test_the_data_of_a_call_keeps_its_frame_and_its_figures(held: Scene) -> None:
    frame = held.call.frame_id
    held.run(1.0, View((Thing(AHEAD),), turned=60.0))
    told = data(held)
    assert (told.id, told.kind, told.stage, told.outcome) == (1, Kind.CALL, Stage.OPEN, Outcome.NONE)
    assert told.frame_id == frame
    assert told.reasons == Reasons.UNKNOWN_OBJECT | Reasons.UNKNOWN_SCENE
    assert told.holding
    assert told.roi_uncertainty == pytest.approx(0.119, abs=1e-3)
    assert told.worst_tile == pytest.approx(0.95, abs=1e-3)
    assert told.worst_tile_box is not None
    assert told.similarity == 1.0
    assert (told.latitude, told.longitude) == (51.5, -0.1)
    assert (told.word_count, told.words) == (2, words_hash(held.words))
    assert told.picture == "7.jpg"


def test_the_data_of_a_hold_without_a_call_shows_the_frame_that_was_blocked(blocked: Scene) -> None:
    (shown,) = blocked.all(HoldShown)
    blocked.run(1.0)
    told = data(blocked)
    assert shown.seen.frame.id < blocked.frame
    assert (told.kind, told.reasons, told.frame_id) == (Kind.HOLD, Reasons.BLOCKED, shown.seen.frame.id)
    assert told.drivable_share == pytest.approx(0.571, abs=1e-3)


def test_a_hold_points_at_the_thing_that_a_name_holds_it_for_and_at_nothing_else(hold: Scene) -> None:
    hold.words[GNOME] = -1.0
    hold.run(1.0, View((Thing(SLIVER, mistaken=0.5),)))
    assert data(hold).worst_tile_box is not None
    scene = Scene(Policy.HOLD, tile=None)
    scene.run(1.0, View((Thing(ACROSS, "log"),), haze=0.1))
    told = data(scene)
    assert (told.kind, told.worst_tile_box) == (Kind.HOLD, None)


def test_the_data_of_a_hold_for_a_fault_show_the_newest_frame(hold: Scene) -> None:
    hold.run(1.0, BROKEN)
    assert hold.all(HoldShown) == []
    assert data(hold).frame_id == hold.frame
    hold.run(1.0, LOG)
    (shown,) = hold.all(HoldShown)
    assert data(hold).frame_id == shown.seen.frame.id


def test_the_data_follow_the_stage(held: Scene) -> None:
    held.answer(words={"drum": 1.0})
    assert data(held).stage is Stage.ANSWERED
    assert data(held).reasons == Reasons.NONE
    held.run(1.0)
    assert data(held).stage is Stage.CLEAR


def test_a_hold_that_is_only_asked_for_does_not_claim_to_hold(hold: Scene) -> None:
    hold.autopilot.deaf = True
    hold.run(1.0, DRUM)
    assert not data(hold).holding


def test_a_call_that_a_restart_found_open_is_told_without_figures(held: Scene) -> None:
    held.restarted()
    told = data(held)
    assert (told.id, told.roi_uncertainty, told.worst_tile_box) == (1, None, None)
    assert text(held) == "C1 unknown thing ahead: go/stay/word"


def test_data_survive_whatever_is_not_known_or_too_much(report: Scene) -> None:
    report.show(View(turned=float("nan")))
    made = call_data(
        report.calls.reason_filter.newest,
        report.numbers.judging.region,
        Preferences(),
        Place(),
        number=0xFFFF,
        kind=Kind.HOLD,
        stage=Stage.CLOSED,
        outcome=Outcome.RECOVERED,
        reasons=(),
        holding=False,
        frame_id=2**40,
        age=1e9,
        picture="p" * 200,
    )
    told = CallReport.unpack(made.pack())
    assert (told.id, told.similarity, told.latitude, told.age_s) == (0xFFFF, None, None, 0xFFFF)
    assert told.picture == "p" * 60


@pytest.mark.parametrize("view", [CLEAR, DRUM, LOG, BROKEN, ELSEWHERE])
def test_a_summary_packs_and_unpacks_for_every_view(report: Scene, view: View) -> None:
    report.run(1.0, view)
    newest = report.calls.reason_filter.newest
    assert newest is not None
    state = report.calls.state(report.now)
    made = summary(newest, SECTORS, state, Policy.REPORT, report.calls.current_id, 90, report.now)
    told = Summary.unpack(made.pack())
    assert told.state is state
    assert told.reasons == flags(newest.reasons)
    assert told.frame_id == newest.frame.id
    assert told.latency_ms == 50
    assert told.sectors == pytest.approx(SECTORS, abs=0.01)
    assert told.current_id == report.calls.current_id
    assert (told.roi_uncertainty is None) is (view is BROKEN)


def test_a_frame_judged_after_the_turn_began_is_as_old_as_its_judging_took(report: Scene) -> None:
    report.run(1.0)
    newest = report.calls.reason_filter.newest
    assert newest is not None
    began = newest.frame.captured_at - 0.2
    made = summary(newest, SECTORS, State.OK, Policy.REPORT, 0, 90, began)
    assert made.frame_age_ms == made.latency_ms == 50


def test_milliseconds_stay_on_the_wire() -> None:
    assert [milliseconds(seconds) for seconds in (-1.0, 0.0123, 1e6)] == [0, 12, 0xFFFF]


def test_the_state_says_first_what_a_human_should_know_first() -> None:
    scene = Scene(Policy.HOLD, mode=MANUAL)
    states = [scene.calls.state(scene.now)]
    scene.run(1.0)
    states.append(scene.calls.state(scene.now))
    for view in (DRUM, LOG, BROKEN):
        scene.run(1.0, view)
        states.append(scene.calls.state(scene.now))
    assert states == [State.STARTING, State.OK, State.CALLING, State.CALLING, State.FAULT]


def test_a_hold_that_stands_in_the_clear_is_holding(held: Scene) -> None:
    held.answer(words={"drum": 1.0})
    held.run(1.0)
    assert held.calls.state(held.now) is State.HOLDING
    assert held.autopilot.mode == HOLD


def test_stay_does_not_change_what_is_asked(held: Scene) -> None:
    before = text(held)
    held.answer(Motion.STAY)
    assert text(held) == before
