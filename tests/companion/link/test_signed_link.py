"""The link with a key, in virtual time; the other ends sign with pymavlink's own code."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.config.link_settings import ConnectionSettings, LinkSettingError, LinkSettings
from companion.link.inbound import RcChannels, VehicleUpdate
from companion.link.signing import RECENT, open_signing
from companion.sim.loopback_link import LoopbackLink
from companion.wire.answers import Acknowledgement, Answer
from companion.wire.ids import Motion, Outcome, Reasons, Result
from companion.wire.ids import Stage as CallStage
from companion.wire.signing import LAST, MINUTE, stream_of, ticks, timestamp_of
from tests.waiting import wait_for

SECRET = bytes(range(1, 33))
WALL = 1_790_000_000.0
NOW = ticks(WALL)
STALE = Acknowledgement(
    1, 9, Result.STALE, CallStage.CLOSED, Outcome.NONE, None, None, Reasons.NONE, 0, "nothing is open"
)


class Peer:
    """Signs and verifies as pymavlink does."""

    def __init__(self, system: int, component: int, *, secret: bytes = SECRET, timestamp: int = NOW) -> None:
        self.mav = mavlink.MAVLink(None, system, component)
        self.mav.signing.secret_key = secret
        self.mav.signing.sign_outgoing = True
        self.mav.signing.timestamp = timestamp

    def frame(self, message: Any, *, signed: bool = True, mavlink1: bool = False) -> bytes:
        self.mav.signing.sign_outgoing = signed
        packed = bytes(message.pack(self.mav, force_mavlink1=mavlink1))
        self.mav.seq = (self.mav.seq + 1) % 256
        return packed


class Stage(LoopbackLink):
    """A link with a key on a udpin wire; `wall`: s since 1970 when it begins."""

    def __init__(
        self, folder: Path, *, wall: float = WALL, exempt: bool = False, settings: LinkSettings | None = None
    ) -> None:
        self.now = 0.0
        path = folder / "key"
        if not path.exists():
            path.touch(0o600)
            path.write_bytes(SECRET)
        signing = open_signing(path, folder, unsigned_autopilot=exempt, wall=lambda: wall + self.now)
        self.store = signing._store
        super().__init__(settings or LinkSettings("udpin:127.0.0.1:0"), vehicle=None, signing=signing)
        self.autopilot = Peer(1, 1)
        self.ground = Peer(255, 190)

    def arrive(self, *frames: bytes, seconds: float = 0.1) -> None:
        for frame in frames:
            self.far.write(frame)
        self.run(seconds)

    def beat(self, **how: bool) -> bytes:
        return self.autopilot.frame(mavlink.MAVLink_heartbeat_message(10, 3, 0x81, 10, 4, 3), **how)

    def go(self, target: int = 0, **how: bool) -> bytes:
        message = mavlink.MAVLink_command_long_message(1, 191, 31010, 0, target, 1, 0, 0, 0, 0, 0)
        return self.ground.frame(message, **how)

    def has_stored(self) -> bool:
        """Whether all timestamps are in the file."""
        return self.store._waiting is None and self.store._waits_since is None

    @property
    def rejected(self) -> dict[str, int]:
        return dict(self.link.counters.rejected)

    @property
    def answers(self) -> list[Answer]:
        return [one for one in self.heard if isinstance(one, Answer)]


@pytest.fixture
def stage(tmp_path: Path) -> Stage:
    stage = Stage(tmp_path)
    stage.arrive(stage.beat(), seconds=2.0)
    return stage


def test_all_that_leaves_is_signed_and_pymavlink_believes_it(stage: Stage) -> None:
    stage.link.texts.send("hello", 4, stage.now)
    stage.run(3)
    frames = [bytes(frame.message.get_msgbuf()) for frame in stage.frames]
    assert len(frames) >= 4
    assert all(stage.ground.mav.decode(bytearray(frame)).get_signed() for frame in frames)
    stamps = [timestamp_of(frame) for frame in frames]
    assert stamps == sorted(set(stamps))
    assert stamps[0] >= NOW


def test_the_budget_pays_for_signatures(tmp_path: Path) -> None:
    stage = Stage(tmp_path)
    stage.arrive(stage.beat())
    stage.run(30)
    assert sum(frame.size for frame in stage.frames) == sum(stage.link.counters.sent.values())


def test_each_connection_signs_with_a_link_id_of_its_own(tmp_path: Path) -> None:
    more = {"wifi": ConnectionSettings("udpout:127.0.0.1:14551")}
    stage = Stage(tmp_path, settings=LinkSettings("udpout:127.0.0.1:14550", more=more))
    stage.arrive(stage.beat(), seconds=3.0)
    for wire, link in ((stage, 0), (stage.more["wifi"], 1)):
        assert wire.frames
        assert {stream_of(bytes(frame.message.get_msgbuf())) for frame in wire.frames} == {(1, 191, link)}


def test_a_signed_answer_is_heard(stage: Stage) -> None:
    stage.arrive(stage.go())
    assert [answer.motion for answer in stage.answers] == [Motion.GO]
    assert stage.rejected == {}


@pytest.mark.parametrize(
    ("how", "reason"),
    [({"signed": False}, "unsigned"), ({"signed": False, "mavlink1": True}, "unsigned")],
)
def test_without_a_signature_nothing_is_answered_and_it_is_counted(
    stage: Stage, how: dict[str, bool], reason: str
) -> None:
    sent = len(stage.frames)
    stage.arrive(stage.go(**how), stage.beat(**how), seconds=0.5)
    assert stage.answers == []
    assert stage.rejected == {reason: 2}
    sent_types = {frame.message.get_type() for frame in stage.frames[sent:]}
    # COMMAND_LONG: the autopilot is asked whether the script runs on it
    assert sent_types <= {"HEARTBEAT", "PARAM_VALUE", "COMMAND_LONG"}


def test_a_forged_far_future_frame_stops_no_genuine_one(stage: Stage) -> None:
    stage.arrive(stage.go())
    for forger in (Peer(255, 190, secret=bytes(32 * [7]), timestamp=LAST - 9), Peer(1, 1, secret=b"x" * 32)):
        stage.ground, genuine = forger, stage.ground
        stage.arrive(stage.go())
        stage.ground = genuine
    assert stage.rejected == {"signature": 2}
    stage.arrive(*(stage.go(target) for target in range(1, 6)))
    assert len(stage.answers) == 6


def test_a_replayed_answer_is_not_applied_again(stage: Stage) -> None:
    frame = stage.go()
    stage.arrive(frame)
    stage.arrive(frame, frame)
    assert len(stage.answers) == 1
    assert stage.rejected == {"replay": 2}


def test_after_a_restart_1000_replayed_frames_do_nothing_and_the_next_genuine_ones_count(
    stage: Stage, tmp_path: Path
) -> None:
    text = mavlink.MAVLink_statustext_message(6, b"x")
    recorded = [stage.ground.frame(text) for _ in range(990)] + [stage.go(target) for target in range(10)]
    for frame in recorded:
        stage.arrive(frame, seconds=0.01)
    assert stage.rejected == {}
    assert len(stage.answers) == 10
    stage.run(0.1)
    wait_for(stage.has_stored)
    after = Stage(tmp_path, wall=WALL + stage.now)
    after.autopilot, after.ground = stage.autopilot, stage.ground
    after.arrive(after.beat())
    for frame in recorded:
        after.arrive(frame, seconds=0.01)
    assert after.answers == []
    assert after.rejected == {"replay": 1000}
    after.arrive(after.go(10), after.beat())
    assert len(after.answers) == 1
    assert after.rejected == {"replay": 1000}


def test_our_own_frames_played_back_do_not_silence_us_but_another_of_us_does(
    stage: Stage, tmp_path: Path
) -> None:
    own = [bytes(frame.message.get_msgbuf()) for frame in stage.frames]
    stage.arrive(*own)
    assert stage.rejected == {"echo": len(own)}
    assert stage.link.trouble is None
    wait_for(stage.has_stored)
    after = Stage(tmp_path, wall=WALL + stage.now)
    after.autopilot = stage.autopilot
    after.arrive(after.beat(), *own)
    assert after.link.trouble is None
    twin = Peer(1, 191, timestamp=NOW + 60 * MINUTE)
    after.arrive(twin.frame(mavlink.MAVLink_heartbeat_message(18, 8, 0, 1, 4, 3)))
    assert "another component 1/191" in str(after.link.trouble)


def test_an_unsigned_autopilot_is_said_with_what_to_do(tmp_path: Path) -> None:
    stage = Stage(tmp_path)
    stage.arrive(stage.beat(signed=False), seconds=1.0)
    assert stage.link.vehicle is None
    assert "load our key into it" in str(stage.link.trouble)
    assert stage.frames == []
    stage.arrive(stage.beat())
    assert stage.link.trouble is None


def test_what_is_refused_of_the_autopilot_is_trouble_for_ten_seconds(tmp_path: Path) -> None:
    stage = Stage(tmp_path)
    signing = open_signing(tmp_path / "key", tmp_path, wall=lambda: WALL)
    message = mavlink.MAVLink(None).decode(bytearray(stage.beat(signed=False)))
    assert signing.refusal(message, 5.0) == "unsigned"
    signing.tick(5.0 + RECENT)
    assert "is not signed" in str(signing.trouble)
    signing.tick(5.1 + RECENT)
    assert signing.trouble is None


def test_what_others_say_in_a_verified_autopilots_name_is_no_trouble_until_it_is_silent(stage: Stage) -> None:
    liar = Peer(1, 1, secret=b"z" * 32)
    for number in range(20):
        stage.arrive(stage.beat(signed=False), stage.beat() if number % 5 == 0 else b"", seconds=0.1)
        assert stage.link.trouble is None
        stage.arrive(liar.frame(mavlink.MAVLink_heartbeat_message(10, 3, 0x81, 0, 4, 3)), seconds=0.1)
        assert stage.link.trouble is None
    assert stage.rejected == {"unsigned": 20, "signature": 20}
    for _ in range(12):
        stage.arrive(stage.beat(signed=False), seconds=1.0)
    assert "is not signed" in str(stage.link.trouble)


def test_an_exempted_autopilot_may_tell_unsigned_but_ask_nothing(tmp_path: Path) -> None:
    stage = Stage(tmp_path, exempt=True)
    pulses = mavlink.MAVLink_rc_channels_message(0, 18, *([1500] * 18), 255)
    remote_control = mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
    health = mavlink.MAVLink_sys_status_message(remote_control, remote_control, 0, *([0] * 10))
    change = mavlink.MAVLink_param_set_message(1, 191, b"AT_POLICY", 3.0, 9)
    stage.autopilot.mav.signing.sign_outgoing = False
    stage.arrive(
        stage.beat(signed=False),
        stage.autopilot.frame(pulses, signed=False),
        stage.autopilot.frame(health, signed=False),
        stage.autopilot.frame(change, signed=False),
        stage.go(signed=False),
        seconds=2.0,
    )
    assert stage.link.vehicle is not None
    assert any(isinstance(one, RcChannels) for one in stage.heard)
    assert stage.answers == []
    assert stage.rejected == {"unsigned": 2}
    assert stage.link.trouble is None, "it is known not to sign"
    stage.arrive(stage.beat(signed=False, mavlink1=True), seconds=1.0)
    assert stage.rejected == {"unsigned": 3}
    assert "is not signed" in str(stage.link.trouble)
    assert all(frame.message.get_signed() is False for frame in stage.frames)
    assert all(frame.message.get_msgbuf()[2] == 1 for frame in stage.frames)


def test_an_autopilot_without_a_key_is_believed_on_the_first_connection_alone(tmp_path: Path) -> None:
    more = {"wifi": ConnectionSettings("udpin:127.0.0.1:0")}
    stage = Stage(tmp_path, exempt=True, settings=LinkSettings("udpin:127.0.0.1:0", more=more))
    forged = stage.beat(signed=False)
    stage.more["wifi"].far.write(forged)
    stage.run(1.0)
    assert stage.reported(VehicleUpdate) == [], "whoever reaches the radio would receive our HOLD"
    assert stage.rejected == {"unsigned": 1}
    stage.arrive(forged)
    assert len(stage.reported(VehicleUpdate)) == 1
    stage.more["wifi"].far.write(stage.beat())
    stage.run(1.0)
    assert stage.rejected == {"unsigned": 1}, "a signed one is believed everywhere"


def test_a_radios_own_frames_count_for_nothing(stage: Stage) -> None:
    radio = Peer(51, 68)
    message = mavlink.MAVLink_radio_status_message(9, 9, 9, 9, 9, 9, 9)
    stage.arrive(*(radio.frame(message, signed=False, mavlink1=old) for old in (False, True)))
    assert stage.rejected == {}


def test_a_radios_frame_under_our_ids_without_the_key_does_not_silence_us(stage: Stage) -> None:
    message = mavlink.MAVLink_radio_status_message(9, 9, 9, 9, 9, 9, 9)
    stage.arrive(Peer(1, 191).frame(message, signed=False))
    assert stage.link.trouble is None
    sent = len(stage.frames)
    stage.run(3.0)
    assert len(stage.frames) >= sent + 3


def test_nor_does_one_under_the_grounds_ids_lead_its_acknowledgements_astray(tmp_path: Path) -> None:
    more = {"wifi": ConnectionSettings("udpout:127.0.0.1:14551")}
    stage = Stage(tmp_path, settings=LinkSettings("udpout:127.0.0.1:14550", more=more))
    stage.arrive(stage.beat(), stage.go(9))
    request = stage.answers[0]
    message = mavlink.MAVLink_radio_status_message(9, 9, 9, 9, 9, 9, 9)
    stage.more["wifi"].far.write(stage.ground.frame(message, signed=False))
    stage.run(0.1)
    stage.link.answers.acknowledge(request, STALE, stage.now)
    stage.run(1.0)
    assert stage.sent("COMMAND_ACK")
    assert not stage.more["wifi"].sent("COMMAND_ACK")


def test_without_a_clock_nothing_is_said_until_a_verified_frame_tells_the_time(tmp_path: Path) -> None:
    stage = Stage(tmp_path, wall=0.0, settings=LinkSettings("udpout:127.0.0.1:14550"))
    stage.arrive(stage.beat(signed=False), stage.go(signed=False), seconds=10.0)
    assert stage.frames == []
    assert "no clock" in str(stage.link.trouble)
    assert stage.link.wait(stage.now) > 0.01
    forger = Peer(1, 1, secret=b"y" * 32)
    stage.arrive(forger.frame(mavlink.MAVLink_system_time_message(int(WALL * 1e6), 0)), seconds=2.0)
    assert stage.frames == []
    stage.arrive(stage.beat(), seconds=2.0)
    assert stage.link.trouble is None
    assert timestamp_of(bytes(stage.frames[0].message.get_msgbuf())) >= NOW


def test_the_autopilots_time_of_day_counts_more_than_its_timestamp(tmp_path: Path) -> None:
    stage = Stage(tmp_path, wall=0.0)
    later = mavlink.MAVLink_system_time_message(int((WALL + 3600) * 1e6), 0)
    stage.arrive(stage.beat(), stage.autopilot.frame(later), seconds=2.0)
    assert timestamp_of(bytes(stage.frames[-1].message.get_msgbuf())) >= NOW + 60 * MINUTE


def test_an_autopilot_with_an_old_time_is_set_right_by_one_frame_of_ours(tmp_path: Path) -> None:
    stage = Stage(tmp_path)
    stage.autopilot = Peer(1, 1, timestamp=NOW - 1000 * MINUTE)
    stage.arrive(stage.beat(), seconds=1.0)
    assert stage.link.vehicle is None
    assert "old time" in str(stage.link.trouble)
    assert stage.autopilot.mav.decode(bytearray(stage.frames[0].message.get_msgbuf())).get_signed()
    stage.arrive(stage.beat())
    assert str(stage.link.vehicle) != "None"
    assert stage.link.trouble is None


def test_nothing_of_the_key_is_logged_or_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.DEBUG)
    stage = Stage(tmp_path)
    stage.arrive(stage.beat(), stage.go(), stage.go(signed=False), seconds=1.0)
    stage.arrive(Peer(255, 190, secret=b"z" * 32).frame(mavlink.MAVLink_ping_message(0, 0, 0, 0)))
    signing = stage.link._signing
    stage.link.close()
    told = [
        caplog.text,
        repr(stage.link.counters),
        repr(signing),
        repr(vars(signing)),
        str(stage.link.trouble),
    ]
    told += [path.read_bytes().decode("latin-1") for path in tmp_path.iterdir() if path.name != "key"]
    assert "refused COMMAND_LONG of 255/190: unsigned" in caplog.text
    for form in (SECRET.hex(), SECRET.decode("latin-1"), repr(SECRET), str(list(SECRET)), "\\x01\\x02"):
        assert not any(form in text for text in told)


@pytest.mark.parametrize("what", ["mode", "folder", "unwritable"])
def test_a_key_or_folder_that_cannot_be_used_is_said_at_the_start(what: str, tmp_path: Path) -> None:
    key = tmp_path / "key"
    key.touch(0o640 if what == "mode" else 0o600)
    key.write_bytes(SECRET)
    folder = tmp_path / ("absent" if what == "folder" else "")
    if what == "unwritable":
        (tmp_path / "signing.state").mkdir()
    said = {"mode": "chmod 600", "folder": "no such file", "unwritable": "is a directory"}[what]
    with pytest.raises(LinkSettingError, match=said):
        open_signing(key, folder)
