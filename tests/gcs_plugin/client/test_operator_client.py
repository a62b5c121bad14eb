"""What the protocol client makes of what it hears: rovers, calls, silence, wrong voices, rubbish."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from anytraverse.operations import SetWord
from companion.wire import ids
from companion.wire.answers import Acknowledgement
from companion.wire.call_report import CallReport
from companion.wire.delivery import DeliveryStatus
from gcs_plugin.client import events as ev
from gcs_plugin.client.client import MAX_ROVERS, OperatorClient

if TYPE_CHECKING:
    from tests.gcs_plugin.conftest import Sky

MakeRover = Callable[..., Any]
BUSH = SetWord("bush", -1.0)


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
    assert [event.call.id for event in sky.of(ev.CallAnnounced)] == [7]
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
    assert [(event.severity, event.text) for event in sky.of(ev.VehicleTextReceived)] == [
        (2, "HOLD: companion silent. AUTO again = go blind"),
        (4, "warned"),
        (3, "C7 FAULT camera silent"),
    ]


def test_a_companion_is_heard_among_any_number_of_vehicles_without_one(
    sky: Sky, tiny_rover: MakeRover
) -> None:
    for system in range(2, 2 + 2 * MAX_ROVERS):
        sky.hear(tiny_rover(system).vehicle())
    for system in range(101, 101 + MAX_ROVERS):
        sky.hear(tiny_rover(system).heartbeat())
    sky.hear(*(tiny_rover(system).vehicle() for system in range(50, 60)))
    assert list(sky.client.rovers) == list(range(101, 101 + MAX_ROVERS))


@pytest.mark.parametrize(("system", "component"), [(1, 1), (1, 190), (2, 191), (255, 191)])
def test_only_component_191_of_that_rover_is_believed(
    sky: Sky, speaker: MakeRover, system: int, component: int
) -> None:
    sky.run(2.0)
    sky.lose_down = lambda _: True
    pending = sky.answer(BUSH)
    sky.run(0.2)
    forged = Acknowledgement(
        pending.answer.transaction, 7, ids.Result.APPLIED, ids.Stage.CLOSED, ids.Outcome.ANSWERED,
        None, None, ids.Reasons.NONE, 0, "",
    )  # fmt: skip
    sky.hear(speaker(system, component).tunnel(ids.TUNNEL_ACKNOWLEDGEMENT, forged.pack()))
    sky.run(0.2)
    assert pending.status is DeliveryStatus.SENT
    assert sky.of(ev.CallEnded) == []
    assert sky.client.rovers[1].open_calls()


def test_a_lost_closing_message_is_made_good_by_the_heartbeat(sky: Sky) -> None:
    sky.run(2.0)
    sky.rover.call = None
    sky.run(2.0)
    assert sky.of(ev.CallEnded) == []
    sky.run(3.0)
    assert [event.call.outcome for event in sky.of(ev.CallEnded)] == [ids.Outcome.NONE]


def test_a_call_that_was_only_thought_closed_opens_again(sky: Sky) -> None:
    sky.run(2.0)
    call, sky.rover.call = sky.rover.call, None
    sky.run(5.0)
    sky.rover.call = call
    sky.run(2.0)
    assert len(sky.of(ev.CallAnnounced)) == 2
    assert sky.client.rovers[1].open_calls()


def test_a_late_repeat_of_a_closed_call_does_not_open_it_again(sky: Sky, thing_call: CallReport) -> None:
    sky.run(2.0)
    sky.answer()
    sky.run(2.0)
    sky.hear(sky.rover.companion.tunnel(ids.TUNNEL_CALL, thing_call.pack()))
    assert sky.client.events() == []
    assert sky.client.rovers[1].open_calls() == []


def test_an_id_that_begins_anew_with_another_frame_is_another_call(sky: Sky, thing_call: CallReport) -> None:
    sky.run(2.0)
    sky.answer()
    sky.run(2.0)
    sky.rover.call = replace(thing_call, frame_id=12)
    sky.run(2.0)
    assert [event.call.frame_id for event in sky.of(ev.CallAnnounced)] == [4711, 12]


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
        pending.answer.transaction, 7, result, ids.Stage.CLOSED, ids.Outcome.NONE,
        None, None, ids.Reasons.NONE, 0, "",
    )  # fmt: skip
    sky.hear(sky.rover.companion.tunnel(ids.TUNNEL_ACKNOWLEDGEMENT, ack.pack()))
    sky.run(0.2)
    assert pending.status is DeliveryStatus.ACKNOWLEDGED
    assert len(sky.of(ev.CallEnded)) == closes
    sky.run(1.0)
    assert len(sky.client.rovers[1].open_calls()) == 1


def test_a_hold_has_a_new_frame_each_time_and_is_still_one_hold(sky: Sky, thing_call: CallReport) -> None:
    hold = replace(thing_call, id=9, kind=ids.Kind.HOLD, reasons=ids.Reasons.BLOCKED)
    for second in range(40):
        sky.rover.call = replace(hold, frame_id=second, age_s=second)
        sky.run(1.0)
    assert [event.call.id for event in sky.of(ev.CallAnnounced)] == [9]
    sky.rover.call = replace(hold, frame_id=3, age_s=0)
    sky.run(1.0)
    assert [event.call.id for event in sky.of(ev.CallAnnounced)] == [9, 9]


def test_a_hold_under_a_newer_call_is_not_thought_closed(sky: Sky, thing_call: CallReport) -> None:
    sky.rover.call = replace(thing_call, id=6, kind=ids.Kind.HOLD, reasons=ids.Reasons.BLOCKED)
    sky.run(2.0)
    sky.rover.call = thing_call
    sky.run(60.0)
    assert [call.data.id for call in sky.client.rovers[1].open_calls()] == [6, 7]
    assert sky.of(ev.CallEnded) == []


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
    assert sky.client.rovers[1].counters.unreadable == 5


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
