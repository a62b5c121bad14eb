from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.config.link_settings import LinkSettings
from companion.link.alerts import AlertRepeater
from companion.sim.loopback_link import LoopbackLink
from companion.wire.call_report import CallReport
from companion.wire.ids import TUNNEL_CALL, TUNNEL_SUMMARY, Outcome, Reasons, Stage
from tests.companion.link.payloads import CALL, SUMMARY

CLOSED = replace(CALL, stage=Stage.CLOSED, outcome=Outcome.ANSWERED)
TEXT = "C7 unknown thing ahead 38%: go/stay/word"
UNLIMITED = LinkSettings("udpout:127.0.0.1:14550", budget=0.0)


def calls(stage: LoopbackLink) -> list[CallReport]:
    return [CallReport.unpack(payload) for payload in stage.tunnels(TUNNEL_CALL)]


def texts(stage: LoopbackLink) -> list[tuple[float, int, str]]:
    return [
        (round(frame.at), frame.message.severity, frame.message.text)
        for frame in stage.frames
        if frame.message.get_type() == "STATUSTEXT"
    ]


def test_call_data_leaves_six_times_within_three_seconds_then_every_ten() -> None:
    stage = LoopbackLink(vehicle=None)
    stage.link.alerts.announce(CALL, TEXT, stage.now)
    stage.run(40, step=0.02)
    assert stage.times("TUNNEL") == pytest.approx([0, 0.6, 1.2, 1.8, 2.4, 3.0, 13.0, 23.0, 33.0], abs=0.2)
    assert calls(stage)[0] == CALL


def test_the_text_repeats_and_becomes_an_alert() -> None:
    stage = LoopbackLink(vehicle=None)
    stage.link.alerts.announce(CALL, TEXT, stage.now)
    stage.run(170, step=0.05)
    assert texts(stage) == [(at, 1 if at >= 45 else 3, TEXT) for at in (0, 15, 30, 45, 105, 165)]


def test_stay_ends_the_escalation_but_not_the_repetition() -> None:
    stage = LoopbackLink(vehicle=None)
    stage.link.alerts.announce(CALL, TEXT, stage.now)
    stage.run(20, step=0.05)
    stage.link.alerts.announce(CALL, TEXT, stage.now, quiet=True)
    stage.run(160, step=0.05)
    assert [(at, severity) for at, severity, _ in texts(stage)] == [(0, 3), (15, 3), (75, 3), (135, 3)]


def test_saying_the_same_again_changes_nothing() -> None:
    once, often = LoopbackLink(vehicle=None), LoopbackLink(vehicle=None)
    once.link.alerts.announce(CALL, TEXT, 0.0)
    for stage in (once, often):
        for second in range(300):
            if stage is often:
                stage.link.alerts.announce(replace(CALL, age_s=second // 10), TEXT, stage.now)
            stage.run(0.1, step=0.05)
    assert often.times("TUNNEL") == once.times("TUNNEL")
    assert texts(often) == texts(once)


def test_the_age_of_a_call_goes_on_between_announcements() -> None:
    stage = LoopbackLink(vehicle=None)
    stage.link.alerts.announce(replace(CALL, age_s=100), TEXT, stage.now)
    stage.run(15, step=0.05)
    assert [call.age_s for call in calls(stage)] == [100, 100, 101, 101, 102, 103, 113]


def test_the_age_goes_on_too_where_the_same_is_said_with_every_turn() -> None:
    stage = LoopbackLink(vehicle=None)
    for _ in range(300):
        stage.link.alerts.announce(replace(CALL, age_s=100), TEXT, stage.now)
        stage.run(0.05, step=0.05)
    assert [call.age_s for call in calls(stage)] == [100, 100, 101, 101, 102, 103, 113]


def test_changed_content_is_told_at_once_but_not_faster_than_the_limits() -> None:
    stage = LoopbackLink(UNLIMITED, vehicle=None)
    stage.link.alerts.announce(CALL, TEXT, stage.now)
    stage.run(6, step=0.02)
    stage.link.alerts.announce(
        replace(CALL, reasons=Reasons(3)), "C7 stays open: still unknown 34%", stage.now
    )
    before = len(stage.frames)
    stage.run(0.1)
    told = [frame.message.get_type() for frame in stage.frames[before:]]
    assert {"STATUSTEXT", "TUNNEL"} <= set(told)
    before = len(stage.frames)
    for step in range(100):
        stage.link.alerts.announce(replace(CALL, frame_id=step), f"C7 text {step}", stage.now)
        stage.run(0.1, step=0.05)
    later = [frame.message.get_type() for frame in stage.frames[before:]]
    assert later.count("TUNNEL") <= 11
    assert later.count("STATUSTEXT") <= 6


def test_a_new_stage_starts_the_repetition_again() -> None:
    stage = LoopbackLink(vehicle=None)
    stage.link.alerts.announce(CALL, TEXT, stage.now)
    stage.run(50, step=0.05)
    stage.link.alerts.announce(replace(CALL, stage=Stage.CLEAR), "C7 clear now, go?", stage.now)
    before = len(texts(stage))
    stage.run(16, step=0.05)
    assert texts(stage)[before:] == [(50, 3, "C7 clear now, go?"), (65, 3, "C7 clear now, go?")]


def test_a_closed_call_is_told_three_times_and_forgotten() -> None:
    stage = LoopbackLink(vehicle=None)
    stage.link.alerts.announce(CALL, TEXT, stage.now)
    stage.run(2, step=0.02)
    for _ in range(50):
        stage.link.alerts.announce(CLOSED, "C7 closed: answered", stage.now)
        stage.run(0.1)
    stage.link.alerts.announce(None, "", stage.now)
    stage.run(100, step=0.05)
    assert [call for call in calls(stage) if call.stage == Stage.CLOSED] == [CLOSED] * 3
    assert texts(stage)[1:] == [(2, 5, "C7 closed: answered")]


def test_a_closed_call_is_told_even_when_the_next_one_follows_at_once() -> None:
    stage = LoopbackLink(UNLIMITED, vehicle=None)
    stage.link.alerts.announce(CALL, TEXT, stage.now)
    stage.run(0.5)
    stage.link.alerts.announce(CLOSED, "C7 closed: answered", stage.now)
    stage.link.alerts.announce(None, "", stage.now)
    stage.link.alerts.announce(replace(CALL, id=8), "C8 new place 0.62: go/stay/word", stage.now)
    stage.run(6, step=0.02)
    told = [(call.id, call.stage) for call in calls(stage)]
    assert told.count((7, Stage.CLOSED)) == 3
    assert told.count((8, Stage.OPEN)) >= 5
    assert [text for _, _, text in texts(stage)] == [
        TEXT,
        "C7 closed: answered",
        "C8 new place 0.62: go/stay/word",
    ]


def test_nothing_open_means_nothing_said() -> None:
    stage = LoopbackLink(vehicle=None)
    stage.link.alerts.announce(CALL, TEXT, stage.now)
    stage.run(1)
    stage.link.alerts.announce(None, "", stage.now)
    before = len(stage.tunnels(TUNNEL_CALL))
    stage.run(60, step=0.05)
    assert len(stage.tunnels(TUNNEL_CALL)) == before
    assert len(texts(stage)) == 1


def test_a_text_without_a_call_repeats_by_itself() -> None:
    stage = LoopbackLink(vehicle=None)
    stage.link.alerts.announce(
        None, "Companion OFF: nobody watches the trail", stage.now, quiet=True, severity=4
    )
    stage.run(130, step=0.05)
    assert [(at, severity) for at, severity, _ in texts(stage)] == [(0, 4), (60, 4), (120, 4)]


def test_an_alert_from_the_start_stays_one() -> None:
    stage = LoopbackLink(vehicle=None)
    stage.link.alerts.announce(CALL, "C7 HOLD FAILED: STOP BY HAND", stage.now, severity=1)
    stage.run(50, step=0.05)
    assert {severity for _, severity, _ in texts(stage)} == {1}


def test_numbers_stop_and_summaries_slow_down_while_a_call_is_open() -> None:
    stage = LoopbackLink(vehicle=None)
    stage.link.alerts.announce(CALL, TEXT, stage.now)
    for _ in range(300):
        stage.link.summary(SUMMARY, stage.now)
        stage.link.numbers({"AT_TRAV": 0.5}, stage.now)
        stage.run(0.1, step=0.05)
    assert stage.sent("NAMED_VALUE_FLOAT") == []
    assert len(stage.tunnels(TUNNEL_SUMMARY)) == 6
    stage.link.alerts.announce(CLOSED, "", stage.now)
    for _ in range(50):
        stage.link.summary(SUMMARY, stage.now)
        stage.link.numbers({"AT_TRAV": 0.5}, stage.now)
        stage.run(0.1, step=0.05)
    assert len(stage.sent("NAMED_VALUE_FLOAT")) >= 2
    assert len(stage.tunnels(TUNNEL_SUMMARY)) >= 10


def test_a_call_overtakes_texts_and_figures() -> None:
    stage = LoopbackLink()
    stage.run(0.5)
    for number in range(8):
        stage.link.texts.send(f"text {number}", 6, stage.now)
    stage.link.summary(SUMMARY, stage.now)
    stage.link.alerts.announce(CALL, TEXT, stage.now)
    before = len(stage.frames)
    stage.run(0.1)
    first, second = (frame.message for frame in stage.frames[before : before + 2])
    assert (first.get_type(), first.text) == ("STATUSTEXT", TEXT)
    assert (second.get_type(), second.payload_type) == ("TUNNEL", TUNNEL_CALL)


def test_a_text_is_said_once_in_five_seconds_and_eight_at_most_wait() -> None:
    stage = LoopbackLink(vehicle=None)
    for number in range(20):
        stage.link.texts.send(f"text {number}", 6, stage.now)
        stage.link.texts.send(f"text {number}", 6, stage.now)
    stage.run(4, step=0.02)
    assert [text for _, _, text in texts(stage)] == [f"text {number}" for number in range(8)]
    stage.link.texts.send("text 0", 6, stage.now)
    stage.run(2)
    assert len(texts(stage)) == 8
    stage.link.texts.send("text 0", 6, stage.now)
    stage.run(1)
    assert len(texts(stage)) == 9


@pytest.mark.parametrize("text", ["x" * 80, "草" * 40, "a\x00b", "\ud800"])
def test_any_text_is_cut_to_what_every_ground_station_shows(text: str) -> None:
    stage = LoopbackLink(vehicle=None)
    stage.link.texts.send(text, 6, stage.now)
    stage.run(0.2)
    raw = stage.sent("STATUSTEXT")[0]._text_raw
    assert len(raw) <= 50
    assert raw.decode()


STEPS = st.lists(
    st.tuples(
        st.floats(0.01, 30),
        st.sampled_from(["open", "stage", "close", "none", "text", "wait"]),
        st.booleans(),
    ),
    max_size=30,
)


@settings(max_examples=60)
@given(STEPS)
def test_whatever_happens_texts_and_data_keep_their_distance(steps: list[tuple[float, str, bool]]) -> None:
    announcer, now, number = AlertRepeater(), 0.0, 1
    data_at: list[float] = []
    for pause, what, quiet in steps:
        call = replace(CALL, id=number)
        match what:
            case "open":
                announcer.announce(call, TEXT, now, quiet=quiet, severity=3)
            case "stage":
                announcer.announce(replace(call, stage=Stage.CLEAR), TEXT, now, quiet=quiet, severity=3)
            case "text":
                announcer.announce(call, f"{TEXT} {now}", now, quiet=quiet, severity=3)
            case "close":
                announcer.announce(replace(call, stage=Stage.CLOSED), "closed", now, quiet=quiet, severity=3)
                number += 1
            case "none":
                announcer.announce(None, "", now, quiet=quiet, severity=3)
        for _ in range(20):
            told = announcer.data(now)
            if told is not None and told.stage != Stage.CLOSED:
                data_at.append(now)
            spoken = 0
            while announcer.text(now) is not None:
                spoken += 1
            assert spoken <= 5
            now += pause / 20
    assert all(after - before >= 0.599 for before, after in pairwise(data_at))
