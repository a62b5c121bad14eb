"""Several ask at once: whose reply leaves next, and whose is lost where too many wait."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from companion.config.link_settings import LinkSettings
from companion.link.connection import Connection
from companion.link.sender import MAX_WAITING, Sender
from companion.sim.loopback_link import pair


def test_a_full_queue_loses_a_frame_of_whoever_waits_for_most() -> None:
    near, _ = pair()
    near.full = True
    connection = Connection(lambda: near, 0.0)
    connection.read(0.0)
    sender = Sender(connection, LinkSettings("udpout:127.0.0.1:1"), 0.0)
    sender.push("list", mavlink.MAVLink_param_value_message(b"AT_X", 0, 9, 1, 0), 0.0, to=(254, 190))
    for _ in range(MAX_WAITING):
        sender.push("command ack", mavlink.MAVLink_command_ack_message(31010, 0), 0.0, to=(255, 190))
    assert (sender.lost, sender.waiting("list"), sender.waiting("command ack")) == (1, 1, MAX_WAITING - 1)


def test_two_who_ask_again_with_every_reply_hold_up_no_third() -> None:
    near, far = pair()
    connection = Connection(lambda: near, 0.0)
    connection.read(0.0)
    sender = Sender(connection, LinkSettings("udpout:127.0.0.1:1"), 0.0)

    def ask(asker: int, now: float) -> None:
        ack = mavlink.MAVLink_command_ack_message(31010, 0, target_system=asker)
        sender.push("command ack", ack, now, to=(asker, 190))

    for asker in (1, 1, 1, 2, 3):
        ask(asker, 0.0)
    told = []
    for step in range(12):
        sender.tick(0.1 * step)
        (sent,) = mavlink.MAVLink(None).parse_buffer(far.read())
        told.append(sent.target_system)
        if sent.target_system > 1:
            ask(sent.target_system, 0.1 * step)
    assert told[:9] == [1, 2, 3] * 3


@settings(max_examples=50)
@given(st.lists(st.integers(0, 3), min_size=1, max_size=MAX_WAITING))
def test_whoever_asked_gets_what_he_asked_for_in_his_turn_and_in_its_order(askers: list[int]) -> None:
    near, far = pair()
    connection = Connection(lambda: near, 0.0)
    connection.read(0.0)
    sender = Sender(connection, LinkSettings("udpout:127.0.0.1:1"), 0.0)
    for number, asker in enumerate(askers):
        ack = mavlink.MAVLink_command_ack_message(number, 0, target_system=asker)
        sender.push("command ack", ack, 0.0, to=(asker, 190), lifetime=60.0)
    told = []
    for step in range(len(askers)):
        sender.tick(0.1 * step)
        (sent,) = mavlink.MAVLink(None).parse_buffer(far.read())
        told.append((sent.command, sent.target_system))
    for asker in askers:
        own = [number for number, to in told if to == asker]
        assert own == [number for number, to in enumerate(askers) if to == asker]
    turns = [sum(to == asker for _, to in told[:place]) for place, (_, asker) in enumerate(told)]
    assert turns == sorted(turns)
