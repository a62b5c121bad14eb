"""Who hears what, sentence by sentence."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from companion.sim.field.router import MAX_ROUTES, DatagramParser, FrameRoute, Port, Router

PASSED_ON = FrameRoute(forward=True, execute=False)
PASSED_ON_AND_OBEYED = FrameRoute(forward=True, execute=True)
OBEYED = FrameRoute(forward=False, execute=True)
IGNORED = FrameRoute(forward=False, execute=False)


def frame_from(system: int, component: int, message: Any, *, signed: bool = False) -> Any:
    mav = mavlink.MAVLink(None, system, component)
    if signed:
        mav.signing.secret_key = bytes(32)
        mav.signing.sign_outgoing = True
    (frame,) = DatagramParser().frames(message.pack(mav))
    return frame


def raw_frame(number: int, payload: bytes, system: int, component: int) -> bytes:
    """A frame of any known id around any payload, with the right checksum."""
    head = mavlink.MAVLink_header(number, 0, 0, len(payload), 0, system, component).pack()
    crc = mavlink.x25crc(bytearray(head[1:] + payload))
    crc.accumulate(bytes([mavlink.mavlink_map[number].crc_extra]))
    return bytes(head + payload + crc.crc.to_bytes(2, "little"))


def heartbeat() -> Any:
    return mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)


def tunnel(system: int, component: int) -> Any:
    return mavlink.MAVLink_tunnel_message(system, component, 45001, 3, b"abc".ljust(128, b"\0"))


def command(system: int, component: int) -> Any:
    return mavlink.MAVLink_command_long_message(system, component, 31010, 0, 0, 0, 0, 0, 0, 0, 0)


@pytest.fixture
def router() -> Router:
    """Has heard the companion 1/191 and a ground station 255/190."""
    router = Router()
    router.decide(Port.COMPANION, frame_from(1, 191, heartbeat()))
    router.decide(Port.GCS, frame_from(255, 190, heartbeat()))
    return router


def test_who_was_heard_is_learned_for_each_port(router: Router) -> None:
    assert router.heard(Port.COMPANION) == {(1, 191)}
    assert router.heard(Port.GCS) == {(255, 190)}


@pytest.mark.parametrize(
    "message",
    [
        heartbeat(),
        tunnel(0, 0),
        mavlink.MAVLink_statustext_message(3, b"C7 unknown thing"),
        mavlink.MAVLink_named_value_float_message(1, b"AT_UNC", 0.4),
        mavlink.MAVLink_param_value_message(b"AT_W_DRUM", -1.0, 9, 1, 0),
        mavlink.MAVLink_param_ext_value_message(b"AT_P1", b"dirt", 1, 1, 0),
        mavlink.MAVLink_message_interval_message(385, 1_000_000),
    ],
    ids=lambda message: str(message.get_type()),
)
def test_what_is_for_everyone_goes_to_the_other_port(router: Router, message: Any) -> None:
    assert router.decide(Port.COMPANION, frame_from(1, 191, message)).forward


def test_what_has_a_target_goes_where_the_target_was_heard(router: Router) -> None:
    assert router.decide(Port.GCS, frame_from(255, 190, command(1, 191))) == PASSED_ON
    assert router.decide(Port.COMPANION, frame_from(1, 191, tunnel(255, 190))) == PASSED_ON


def test_another_system_is_reached_through_any_component_heard_of_it(router: Router) -> None:
    assert router.decide(Port.COMPANION, frame_from(1, 191, tunnel(255, 77))) == PASSED_ON
    assert router.decide(Port.COMPANION, frame_from(1, 191, tunnel(254, 190))) == IGNORED


def test_what_is_meant_for_a_component_never_heard_is_neither_passed_on_nor_obeyed(router: Router) -> None:
    assert router.decide(Port.GCS, frame_from(255, 190, command(1, 192))) == IGNORED
    assert Router().decide(Port.GCS, frame_from(255, 190, command(1, 191))) == IGNORED


def test_what_is_meant_for_the_sender_s_own_port_is_not_passed_on(router: Router) -> None:
    router.decide(Port.GCS, frame_from(254, 1, heartbeat()))
    assert router.decide(Port.GCS, frame_from(254, 1, tunnel(255, 190))) == IGNORED


def test_what_is_meant_for_the_autopilot_stays_here(router: Router) -> None:
    assert router.decide(Port.GCS, frame_from(255, 190, command(1, 1))) == OBEYED
    assert router.decide(Port.COMPANION, frame_from(1, 191, tunnel(1, 1))) == OBEYED


def test_what_is_meant_for_every_component_of_the_system_is_obeyed_and_passed_on(router: Router) -> None:
    assert router.decide(Port.GCS, frame_from(255, 190, command(1, 0))) == PASSED_ON_AND_OBEYED
    set_mode = mavlink.MAVLink_set_mode_message(1, 1, 4)
    assert router.decide(Port.GCS, frame_from(255, 190, set_mode)) == PASSED_ON_AND_OBEYED


def test_ids_that_the_autopilot_does_not_know_are_dropped(router: Router) -> None:
    (status,) = DatagramParser().frames(
        raw_frame(mavlink.MAVLINK_MSG_ID_ONBOARD_COMPUTER_STATUS, bytes(9), 1, 191)
    )
    assert router.decide(Port.COMPANION, status) == IGNORED


def test_a_message_number_in_no_dialect_is_rubbish() -> None:
    frame = bytearray(heartbeat().pack(mavlink.MAVLink(None, 1, 191)))
    frame[7:10] = (54_321).to_bytes(3, "little")
    parser = DatagramParser()
    assert parser.frames(bytes(frame)) == []
    assert parser.bad == 1


def test_its_own_words_coming_back_are_dropped(router: Router) -> None:
    assert router.decide(Port.GCS, frame_from(1, 1, heartbeat())) == IGNORED
    assert router.heard(Port.GCS) == {(255, 190)}


def test_routes_are_bounded(router: Router) -> None:
    for component in range(2, 80):
        router.decide(Port.GCS, frame_from(9, component, heartbeat()))
    assert len(router.heard(Port.GCS)) + len(router.heard(Port.COMPANION)) == MAX_ROUTES


def test_a_signed_frame_is_parsed_with_its_signature() -> None:
    frame = frame_from(255, 190, heartbeat(), signed=True)
    assert len(frame.get_msgbuf()) == len(frame_from(255, 190, heartbeat()).get_msgbuf()) + 13


def test_half_a_frame_does_not_harm_the_next_datagram() -> None:
    parser = DatagramParser()
    whole = heartbeat().pack(mavlink.MAVLink(None, 1, 191))
    assert parser.frames(whole[:9]) == []
    assert len(parser.frames(whole)) == 1


def test_a_frame_with_a_wrong_checksum_is_left_out_and_its_neighbour_kept() -> None:
    whole = heartbeat().pack(mavlink.MAVLink(None, 1, 191))
    broken = whole[:-1] + bytes([whole[-1] ^ 0xFF])
    parser = DatagramParser()
    assert len(parser.frames(broken + whole)) == 1
    assert parser.bad == 1


@settings(max_examples=150, deadline=None)
@given(noise=st.binary(max_size=300), marker=st.sampled_from([b"", b"\xfd", b"\xfe"]))
def test_noise_is_survived(noise: bytes, marker: bytes) -> None:
    DatagramParser().frames(marker + noise)


@settings(max_examples=150, deadline=None)
@given(number=st.sampled_from(sorted(mavlink.mavlink_map)), payload=st.binary(min_size=1, max_size=255))
def test_any_payload_under_a_correct_checksum_is_routed_without_an_error(number: int, payload: bytes) -> None:
    (frame,) = DatagramParser().frames(raw_frame(number, payload, 255, 190))
    Router().decide(Port.GCS, frame)
