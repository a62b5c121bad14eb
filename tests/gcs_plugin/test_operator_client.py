"""The protocol client in virtual time: losses, silence, wrong voices."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from companion.wire import ids
from companion.wire.answers import Acknowledgement, AnswerMessage, Operation, SetWord
from companion.wire.packing import PayloadError
from companion.wire.payloads import CallData
from gcs_plugin import events as ev
from gcs_plugin.client import MAX_ROVERS, OperatorClient
from gcs_plugin.pending import Pending, Status

MakeRover = Callable[..., Any]
BUSH = SetWord("bush", -1.0)


class Sky:
    """A client and a tiny rover with a link between them that loses what it is told to, in virtual time."""

    def __init__(self, rover: Any, ground: Any) -> None:
        self.rover, self.ground = rover, ground
        self.client = OperatorClient()
        self.now = 100.0
        self.told: list[ev.Event] = []
        self.sent: list[float] = []
        self.rover_speaks = True
        self.lose_up: Callable[[int], bool] = lambda _: False
        self.lose_down: Callable[[int], bool] = lambda _: False
        self.unheard: set[int] = set()
        self._up = self._down = 0
        self._speak_at = self.now

    def hear(self, *frames: bytes) -> None:
        for message in self.ground.parse(b"".join(frames)):
            self.client.receive(message, self.now)

    def run(self, seconds: float) -> None:
        until = self.now + seconds
        while self.now < until:
            self.now = round(self.now + 0.05, 3)
            if self.rover_speaks and self.now >= self._speak_at:
                self._speak_at = self.now + 1.0
                self._carry_up(self.rover.speak())
            for message in self.client.outgoing(self.now):
                self.sent.append(self.now)
                self._down += 1
                if not self.lose_down(self._down) and not self._never_heard(message):
                    replies = self.rover.hear(self.ground.frame(message))
                    self._carry_up(replies if self.rover_speaks else [])
            self.told += self.client.events()

    def _never_heard(self, message: Any) -> bool:
        if message.get_type() != "TUNNEL":
            return False
        answer = AnswerMessage.unpack(bytes(message.payload[: message.payload_length]))
        return answer.transaction in self.unheard

    def _carry_up(self, frames: Sequence[bytes]) -> None:
        for frame in frames:
            self._up += 1
            if not self.lose_up(self._up):
                self.hear(frame)

    def answer(self, *operations: Operation, motion: ids.Motion = ids.Motion.GO, target: int = 7) -> Pending:
        return self.client.answer(1, target, motion, operations, self.now)

    def of(self, kind: type[Any]) -> list[Any]:
        return [event for event in self.told if isinstance(event, kind)]


@pytest.fixture
def sky(tiny_rover: MakeRover, speaker: MakeRover, thing_call: CallData) -> Sky:
    return Sky(tiny_rover(1, thing_call), speaker(255, 190))


def test_a_rover_is_known_by_its_companions_heartbeat(sky: Sky) -> None:
    sky.hear(sky.rover.vehicle())
    assert sky.client.rovers == {}
    sky.run(1.0)
    rover = sky.client.rovers[1]
    assert (rover.state, rover.current_id) == (ids.State.CALLING, 7)
    assert rover.vehicle is not None
    assert rover.vehicle.text == "AUTO armed"
    assert sky.of(ev.LinkChanged) == [ev.LinkChanged(1, up=True)]


def test_a_call_that_repeats_is_told_once(sky: Sky) -> None:
    sky.run(10.0)
    assert [event.call.id for event in sky.of(ev.CallOpened)] == [7]
    assert sky.of(ev.CallChanged) == []


def test_warnings_of_the_autopilot_are_told_and_its_echoes_of_the_companion_are_not(sky: Sky) -> None:
    def says(severity: int, text: str) -> bytes:
        frame: bytes = sky.rover.autopilot.frame(mavlink.MAVLink_statustext_message(severity, text.encode()))
        return frame

    sky.run(1.0)
    sky.hear(sky.rover.text("C7 FAULT camera silent"), says(3, "C7 FAULT camera silent"))
    sky.hear(says(2, "HOLD: companion silent. AUTO again = go blind"), says(4, "warned"), says(6, "chat"))
    sky.now += 10.0
    sky.hear(says(3, "C7 FAULT camera silent"))
    sky.run(0.1)
    assert [(event.severity, event.text) for event in sky.of(ev.VehicleTextHeard)] == [
        (2, "HOLD: companion silent. AUTO again = go blind"),
        (4, "warned"),
        (3, "C7 FAULT camera silent"),
    ]


def test_an_answer_is_applied_acknowledged_and_closes_the_call(sky: Sky) -> None:
    sky.run(2.0)
    pending = sky.answer(BUSH)
    sky.run(1.0)
    assert pending.status is Status.ACKNOWLEDGED
    assert sky.rover.applied == [(7, ids.Motion.GO, (BUSH,))]
    assert [event.call.outcome for event in sky.of(ev.CallClosed)] == [ids.Outcome.ANSWERED]
    sky.run(70.0)
    assert len(sky.sent) == 1


@pytest.mark.parametrize("n", [3, 5, 7])
def test_an_answer_survives_the_loss_of_every_nth_message_both_ways(sky: Sky, n: int) -> None:
    sky.lose_up = sky.lose_down = lambda count: count % n == 0
    sky.run(5.0)
    pending = sky.answer(BUSH)
    sky.run(60.0)
    assert pending.status in (Status.ACKNOWLEDGED, Status.CLOSED)
    assert sky.rover.applied == [(7, ids.Motion.GO, (BUSH,))]
    assert len(sky.of(ev.CallClosed)) == 1
    lost = sky.client.rovers[1].counters
    assert lost.summaries + lost.summaries_lost == pytest.approx(sky.rover.sequence, abs=2)


def test_it_is_sent_again_with_back_off_and_given_up_after_a_minute(sky: Sky) -> None:
    sky.run(2.0)
    sky.lose_down = lambda _: True
    pending = sky.answer(BUSH)
    start = sky.now
    sky.run(70.0)
    assert [round(at - start) for at in sky.sent] == [0, 1, *range(3, 60, 4)]
    assert pending.status is Status.EXPIRED
    assert sky.of(ev.AnswerMoved)[-1].status is Status.EXPIRED


def test_a_lost_acknowledgement_is_fetched_by_sending_again_and_applied_once(sky: Sky) -> None:
    sky.rover.stage_after = ids.Stage.ANSWERED
    sky.run(2.0)
    lost_until = sky.now + 2.5
    sky.lose_up = lambda _: sky.now < lost_until
    pending = sky.answer(BUSH)
    sky.run(10.0)
    assert pending.status is Status.ACKNOWLEDGED
    assert len(sky.rover.applied) == 1
    assert len(sky.sent) == 3


def test_a_call_that_is_closed_by_something_else_ends_the_sending(sky: Sky) -> None:
    sky.run(2.0)
    sky.lose_down = lambda _: True
    pending = sky.answer(BUSH)
    sky.run(1.5)
    sky.rover.call = replace(sky.rover.call, stage=ids.Stage.CLOSED, outcome=ids.Outcome.PASSED)
    sky.run(1.0)
    assert [event.call.outcome for event in sky.of(ev.CallClosed)] == [ids.Outcome.PASSED]
    sent = len(sky.sent)
    sky.run(10.0)
    assert pending.status is Status.CLOSED
    assert len(sky.sent) == sent


def test_a_duplicate_acknowledgement_changes_nothing(sky: Sky) -> None:
    sky.run(2.0)
    sky.answer(BUSH)
    sky.run(1.0)
    before = list(sky.told)
    for frame in sky.rover._acknowledgements.values():
        sky.hear(sky.rover.companion.tunnel(ids.TUNNEL_ACKNOWLEDGEMENT, frame))
    assert sky.client.rovers[1].counters.duplicate_acknowledgements == 1
    assert sky.client.events() == []
    assert len(sky.told) == len(before)


def test_a_stale_answer_is_told_and_not_repeated(sky: Sky) -> None:
    sky.rover.result = ids.Result.STALE
    sky.run(2.0)
    sky.answer(target=3)
    sky.run(20.0)
    assert [event.acknowledgement.result for event in sky.of(ev.Acknowledged)] == [ids.Result.STALE]
    assert len(sky.sent) == 1


def test_a_busy_rover_is_asked_again(sky: Sky) -> None:
    sky.rover.result, sky.rover.stage_after = ids.Result.BUSY, ids.Stage.OPEN
    sky.run(2.0)
    pending = sky.answer(BUSH)
    sky.run(4.0)
    assert not pending.settled
    assert len(sky.sent) == 3
    sky.rover.result, sky.rover.stage_after = ids.Result.APPLIED, ids.Stage.CLOSED
    sky.rover._acknowledgements.clear()
    sky.run(8.0)
    assert pending.status is Status.ACKNOWLEDGED


def test_a_rover_that_is_busy_too_late_is_not_said_to_be_asked_again(sky: Sky) -> None:
    sky.rover.result, sky.rover.stage_after = ids.Result.BUSY, ids.Stage.OPEN
    sky.run(2.0)
    sky.lose_up = lambda _: bool(sky.sent)
    pending = sky.answer(BUSH)
    sky.run(61.0)
    assert pending.status is Status.EXPIRED
    late = Acknowledgement(
        pending.transaction, 7, ids.Result.BUSY, ids.Stage.OPEN, ids.Outcome.NONE,
        None, None, ids.Reasons.NONE, 99, "the eyes are busy",
    )  # fmt: skip
    sky.hear(sky.rover.companion.tunnel(ids.TUNNEL_ACKNOWLEDGEMENT, late.pack()))
    sky.run(1.0)
    assert sky.of(ev.Acknowledged) == []


def test_a_companion_is_heard_among_any_number_of_vehicles_without_one(
    sky: Sky, tiny_rover: MakeRover
) -> None:
    for system in range(2, 2 + 2 * MAX_ROVERS):
        sky.hear(tiny_rover(system).vehicle())
    for system in range(101, 101 + MAX_ROVERS):
        sky.hear(tiny_rover(system).heartbeat())
    sky.hear(*(tiny_rover(system).vehicle() for system in range(50, 60)))
    assert list(sky.client.rovers) == list(range(101, 101 + MAX_ROVERS))


def test_nothing_is_sent_to_a_rover_that_is_silent_for_three_seconds(sky: Sky) -> None:
    sky.run(2.0)
    sky.rover_speaks = False
    sky.run(4.0)
    assert sky.of(ev.LinkChanged)[-1] == ev.LinkChanged(1, up=False)
    pending = sky.answer(BUSH)
    sky.run(10.0)
    assert (pending.status, sky.sent) == (Status.WAITING, [])
    assert sky.of(ev.AnswerMoved)[-1].status is Status.WAITING
    sky.rover_speaks = True
    sky.run(2.0)
    assert pending.status is Status.ACKNOWLEDGED


def test_nothing_is_sent_to_a_rover_that_was_never_heard(sky: Sky) -> None:
    sky.rover_speaks = False
    sky.answer(BUSH)
    sky.client.request_parameters(1)
    sky.run(61.0)
    assert sky.sent == []
    assert sky.of(ev.AnswerMoved)[-1].status is Status.EXPIRED


@pytest.mark.parametrize(("system", "component"), [(1, 1), (1, 190), (2, 191), (255, 191)])
def test_only_component_191_of_that_rover_is_believed(
    sky: Sky, speaker: MakeRover, system: int, component: int
) -> None:
    sky.run(2.0)
    sky.lose_down = lambda _: True
    pending = sky.answer(BUSH)
    sky.run(0.2)
    forged = Acknowledgement(
        pending.transaction, 7, ids.Result.APPLIED, ids.Stage.CLOSED, ids.Outcome.ANSWERED,
        None, None, ids.Reasons.NONE, 0, "",
    )  # fmt: skip
    sky.hear(speaker(system, component).tunnel(ids.TUNNEL_ACKNOWLEDGEMENT, forged.pack()))
    sky.run(0.2)
    assert pending.status is Status.SENT
    assert sky.of(ev.CallClosed) == []
    assert sky.client.rovers[1].open_calls()


def test_a_long_answer_goes_in_parts_at_a_pace_that_radios_bear(sky: Sky) -> None:
    words = tuple(SetWord(f"a word that is long enough to fill {number}", 0.5) for number in range(8))
    sky.run(2.0)
    pending = sky.answer(*words)
    sky.run(2.0)
    assert pending.status is Status.ACKNOWLEDGED
    assert sky.rover.applied == [(7, ids.Motion.GO, words)]
    assert len(sky.sent) == 4
    assert min(b - a for a, b in zip(sky.sent, sky.sent[1:], strict=False)) >= 0.05 - 1e-9


def test_a_part_that_is_lost_comes_again_with_all_the_others(sky: Sky) -> None:
    words = tuple(SetWord(f"a word that is long enough to fill {number}", 0.5) for number in range(4))
    sky.run(2.0)
    sky.lose_down = lambda count: count == 2
    sky.answer(*words)
    sky.run(3.0)
    assert sky.rover.applied == [(7, ids.Motion.GO, words)]


def test_answers_to_one_rover_keep_their_order(sky: Sky) -> None:
    sky.rover.stage_after = ids.Stage.ANSWERED
    sky.run(2.0)
    sky.lose_down = lambda count: count == 1
    sky.answer(BUSH, motion=ids.Motion.NONE)
    sky.answer(motion=ids.Motion.GO)
    sky.run(10.0)
    assert [motion for _, motion, _ in sky.rover.applied] == [ids.Motion.NONE, ids.Motion.GO]


def test_an_answer_that_is_never_acknowledged_keeps_the_next_one_back_for_eight_seconds(sky: Sky) -> None:
    sky.run(2.0)
    sky.unheard.add(sky.answer(BUSH, motion=ids.Motion.NONE).transaction)
    second = sky.answer(motion=ids.Motion.STAY)
    sky.run(7.0)
    assert second.first_sent is None
    sky.run(2.0)
    assert second.status is Status.ACKNOWLEDGED


def test_what_cannot_be_told_on_the_wire_is_refused_at_once(sky: Sky) -> None:
    with pytest.raises(PayloadError, match="send them in two"):
        sky.answer(*[SetWord("a word of some length", 1.0)] * 33)
    with pytest.raises(PayloadError, match="shorter word"):
        sky.answer(SetWord("ü" * 49, 1.0))


def test_a_lost_closing_message_is_made_good_by_the_heartbeat(sky: Sky) -> None:
    sky.run(2.0)
    sky.rover.call = None
    sky.run(2.0)
    assert sky.of(ev.CallClosed) == []
    sky.run(3.0)
    assert [event.call.outcome for event in sky.of(ev.CallClosed)] == [ids.Outcome.NONE]


def test_a_call_that_was_only_thought_closed_opens_again(sky: Sky) -> None:
    sky.run(2.0)
    call, sky.rover.call = sky.rover.call, None
    sky.run(5.0)
    sky.rover.call = call
    sky.run(2.0)
    assert len(sky.of(ev.CallOpened)) == 2
    assert sky.client.rovers[1].open_calls()


def test_a_late_repeat_of_a_closed_call_does_not_open_it_again(sky: Sky, thing_call: CallData) -> None:
    sky.run(2.0)
    sky.answer()
    sky.run(2.0)
    sky.hear(sky.rover.companion.tunnel(ids.TUNNEL_CALL, thing_call.pack()))
    assert sky.client.events() == []
    assert sky.client.rovers[1].open_calls() == []


def test_an_id_that_begins_anew_with_another_frame_is_another_call(sky: Sky, thing_call: CallData) -> None:
    sky.run(2.0)
    sky.answer()
    sky.run(2.0)
    sky.rover.call = replace(thing_call, frame_id=12)
    sky.run(2.0)
    assert [event.call.frame_id for event in sky.of(ev.CallOpened)] == [4711, 12]


@pytest.mark.parametrize(
    ("result", "closes"),
    [
        (ids.Result.DENIED, False),
        (ids.Result.REFUSED, False),
        (ids.Result.APPLIED, False),
        (ids.Result.STALE, True),
    ],
)
def test_an_acknowledgement_without_an_outcome_closes_the_call_only_when_it_is_stale(
    sky: Sky, result: ids.Result, *, closes: bool
) -> None:
    sky.run(2.0)
    sky.lose_down = lambda _: True
    pending = sky.answer(BUSH)
    sky.run(0.2)
    ack = Acknowledgement(
        pending.transaction, 7, result, ids.Stage.CLOSED, ids.Outcome.NONE,
        None, None, ids.Reasons.NONE, 0, "",
    )  # fmt: skip
    sky.hear(sky.rover.companion.tunnel(ids.TUNNEL_ACKNOWLEDGEMENT, ack.pack()))
    sky.run(0.2)
    assert pending.status is Status.ACKNOWLEDGED
    assert len(sky.of(ev.CallClosed)) == closes
    sky.run(1.0)
    assert len(sky.client.rovers[1].open_calls()) == 1


def test_a_hold_has_a_new_frame_each_time_and_is_still_one_hold(sky: Sky, thing_call: CallData) -> None:
    hold = replace(thing_call, id=9, kind=ids.Kind.HOLD, reasons=ids.Reasons.BLOCKED)
    for second in range(40):
        sky.rover.call = replace(hold, frame_id=second, age_s=second)
        sky.run(1.0)
    assert [event.call.id for event in sky.of(ev.CallOpened)] == [9]
    sky.rover.call = replace(hold, frame_id=3, age_s=0)
    sky.run(1.0)
    assert [event.call.id for event in sky.of(ev.CallOpened)] == [9, 9]


def test_a_hold_under_a_newer_call_is_not_thought_closed(sky: Sky, thing_call: CallData) -> None:
    sky.rover.call = replace(thing_call, id=6, kind=ids.Kind.HOLD, reasons=ids.Reasons.BLOCKED)
    sky.run(2.0)
    sky.rover.call = thing_call
    sky.run(60.0)
    assert [call.data.id for call in sky.client.rovers[1].open_calls()] == [6, 7]
    assert sky.of(ev.CallClosed) == []


def test_summaries_that_are_lost_are_counted_and_a_restart_is_not(sky: Sky) -> None:
    sky.run(3.0)
    sky.rover.sequence += 2
    sky.run(1.0)
    counters = sky.client.rovers[1].counters
    assert counters.summaries_lost == 2
    sky.rover.sequence = 5000
    sky.run(1.0)
    sky.rover.sequence = 0
    sky.run(1.0)
    assert counters.summaries_lost == 2
    assert set(counters.latencies_ms) == {120}


@pytest.mark.parametrize("name", [b"AT_W_\x1b[2J", b"AT_W_\xc3\xa9", b"", b"at_w_bush"])
def test_a_parameter_whose_name_cannot_be_one_is_not_taken_in(sky: Sky, name: bytes) -> None:
    sky.run(2.0)
    sky.hear(sky.rover.companion.frame(mavlink.MAVLink_param_value_message(name, 1.0, 9, 2, 1)))
    assert sky.client.rovers[1].parameters == {}


def test_the_words_are_known_from_the_parameters(sky: Sky) -> None:
    sky.client.request_parameters(1)
    sky.run(2.0)
    assert sky.client.rovers[1].words() == {"grass": 1.0}
    assert sky.rover.lists_asked == 1


def test_rubbish_is_counted_and_told_once(sky: Sky) -> None:
    sky.run(1.0)
    companion = sky.rover.companion
    foreign = bytes([2]) + sky.rover.call.pack()[1:]
    for frame in (
        companion.tunnel(ids.TUNNEL_CALL, foreign),
        companion.tunnel(ids.TUNNEL_CALL, foreign),
        companion.tunnel(ids.TUNNEL_SUMMARY, b"\x01\x02"),
        companion.tunnel(ids.TUNNEL_ACKNOWLEDGEMENT, b"\x01", length=250),
        companion.frame(mavlink.MAVLink_heartbeat_message(18, 8, 0, 99, 4, 3)),
        companion.frame(mavlink.MAVLink_statustext_message(3, b"\xff\xfe bad")),
        companion.frame(mavlink.MAVLink_param_value_message(b"AT_W_\xff", float("nan"), 9, 1, 0)),
        b"\xfd\x00\xff garbage \xfe\x09",
    ):
        sky.hear(frame)
    sky.run(0.1)
    problems = [event.problem for event in sky.of(ev.NotUnderstood)]
    assert len(problems) == 4
    assert "update the older end" in problems[0]
    assert sky.client.rovers[1].counters.rubbish == 5


@settings(max_examples=60, deadline=None)
@given(
    kind=st.sampled_from([45001, 45002, 45003, 45004, 7]),
    payload=st.binary(max_size=128),
    length=st.integers(0, 255),
    component=st.sampled_from([1, 191]),
)
def test_no_tunnel_payload_ever_raises(kind: int, payload: bytes, length: int, component: int) -> None:
    client = OperatorClient()
    message = mavlink.MAVLink_tunnel_message(0, 0, kind, length, payload.ljust(128, b"\0"))
    message._header.srcSystem, message._header.srcComponent = 1, component
    client.receive(message, 1.0)
    client.outgoing(1.0)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.binary(max_size=300), max_size=8))
def test_no_bytes_from_the_air_ever_raise(pieces: list[bytes]) -> None:
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    client = OperatorClient()
    for piece in pieces:
        for message in parser.parse_buffer(b"\xfd" + piece) or []:
            client.receive(message, 1.0)


def test_more_rovers_than_anyone_can_watch_are_left_out(speaker: MakeRover) -> None:
    client, ground = OperatorClient(), speaker(255, 190)
    for system in range(1, 100):
        frame = speaker(system, 191).frame(mavlink.MAVLink_heartbeat_message(18, 8, 0, 1, 4, 3))
        for message in ground.parse(frame):
            client.receive(message, 1.0)
    assert len(client.rovers) == 16
