"""The row that says whether it would be seen that the vehicle drives where its camera does not look."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.config import load_config
from companion.desk.check.autopilot import AutopilotReadings, CourseListener
from companion.desk.check.rover import CheckedRover
from companion.desk.check.stopping import check_course
from companion.link.parser import Parser

HEARTBEAT = mavlink.MAVLink_heartbeat_message(10, 3, 129, 10, 4, 3)
ATTITUDE = mavlink.MAVLink_attitude_message(0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


def position(lat: int = 470_000_000, hdg: int = 9000) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_global_position_int_message(0, lat, lat and 80_000_000, 0, 0, 0, 0, 0, hdg)


def missing(*messages: mavlink.MAVLink_message) -> str:
    mav, parser, listener = mavlink.MAVLink(None, 1, 1), Parser(), CourseListener(1)
    for number, message in enumerate((HEARTBEAT, *messages)):
        for parsed in parser.feed(bytes(message.pack(mav)), float(number), whole=True):
            listener.hear(parsed, 0.1 * number)
    return listener.missing


def test_what_is_missing_is_found_in_what_the_autopilot_sends() -> None:
    assert missing() == missing(position(lat=0)) == missing(ATTITUDE) == "position"
    assert missing(position(hdg=65535)) == "heading"
    assert missing(position()) == missing(ATTITUDE, position(hdg=65535)) == ""
    assert missing(position(hdg=65535), ATTITUDE) == ""


def verdict(
    folder: Path, asked: AutopilotReadings | None = None, running: dict[str, Any] | None = None
) -> tuple[str, str]:
    path = folder / "companion.toml"
    path.write_text('[vehicle]\nfile = ""\n[mount]\nheading = 90\n')
    rover = CheckedRover(load_config(str(path)), str(path), folder, running)
    if asked is not None:
        rover.__dict__["asked"] = asked  # as if it had been asked
    (found,) = check_course(rover)
    return found.verdict.name.lower(), found.text


@pytest.mark.parametrize(
    ("course", "level", "told"),
    [
        ("", "pass", "the camera looks 90 degrees off the nose, 60 wide"),
        ("position", "warn", "stream GLOBAL_POSITION_INT here"),
        ("heading", "warn", "no heading is heard"),
    ],
)
def test_what_was_asked_and_what_a_running_companion_says_are_told_alike(
    tmp_path: Path, course: str, level: str, told: str
) -> None:
    for found in (
        verdict(tmp_path, AutopilotReadings(course=course)),
        verdict(tmp_path, running={"course": course}),
    ):
        assert (found[0], told in found[1]) == (level, True), found


def test_without_an_autopilot_or_from_an_older_companion_it_is_skipped(tmp_path: Path) -> None:
    assert verdict(tmp_path, AutopilotReadings(heard=False))[0] == verdict(tmp_path, running={})[0] == "skip"
