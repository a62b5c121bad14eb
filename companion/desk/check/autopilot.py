"""Connects to the autopilot as configured, reads its parameters, and judges them."""

from __future__ import annotations

import math
import select
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.config import Config
from companion.config.link_settings import LinkSettingError, read_url
from companion.desk.check.interview import (
    HEARD_WITHIN,
    NAMES,
    PATIENCE,
    PX4,
    Facts,
    Interview,
    judge,
    names,
    speed,
)
from companion.desk.check.rules import CheckFinding, Verdict, failed, warned
from companion.link.connection import Connection
from companion.link.signing import Signing, open_signing
from companion.link.transport import check_installed, open_transport
from companion.link.vehicle import VehicleTracker
from companion.vehicle import known_autopilot
from companion.vehicle.course import unknown
from companion.wire.ids import COMPONENT_ID

LINK, CHECK = "link", "autopilot"
LIMIT = 40.0
COURSE_WITHIN = 3.5
"""Seconds for which position and heading are waited for, once the parameters came."""
COURSE_MESSAGES = (mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, mavlink.MAVLINK_MSG_ID_ATTITUDE)
_TICK = 0.02
_UNGUARDED = (
    "when the companion dies a PX4 rover drives on: keep a transmitter with a HOLD switch in somebody's "
    'hand, or set [call] px4_deadman = "manual_control", for which PX4 ignores the transmitter '
    "(docs/autopilots.md)"
)
_GUARDED = (
    "px4_deadman: a MISSION ends in LOITER when the companion dies under policy hold; in PX4's own "
    "simulation that was tried once. PX4 ignores the transmitter and its mode switch: stop it from the "
    "ground station"
)
_NOT_A_PX4 = "[call] px4_deadman is ignored here: on ArduPilot the script stops the vehicle"


@dataclass
class AutopilotReadings:
    """Holds what is known of the autopilot after asking it.

    findings: about autopilot and link. speed: name and m/s of the parameter that sets its speed.
    overrun: m that it drives on in the mode that holds it. heard: whether an autopilot was received.
    url: of the connection on which it was. grounds: (system, component) of ground stations that were, too.
    course: what is missing to know where it drives, see `companion.vehicle.course.unknown`.
    """

    findings: list[CheckFinding] = field(default_factory=list)
    speed: tuple[str, float] | None = None
    overrun: float = 0.0
    heard: bool = True
    url: str = ""
    grounds: tuple[tuple[int, int], ...] = ()
    course: str = "position"


def ask_first(config: Config, urls: Sequence[str]) -> AutopilotReadings:
    """Ask the autopilot by the first of `urls` on which one is received; the others need not have one."""
    silent: list[CheckFinding] = []
    for url in urls:
        asked = ask(config, url)
        if asked.heard:
            told = [warned(one.check, f"not here: {one.text}") for one in silent]
            return replace(asked, findings=[*told, *asked.findings])
        silent += asked.findings
    return AutopilotReadings(silent, heard=False)


def ask(config: Config, url: str) -> AutopilotReadings:
    """Ask the autopilot behind `url`. Takes up to 10 s to find it, and at most `LIMIT` seconds in all."""
    try:
        with talking(config, url, names) as (interview, turn):
            until = interview.began + LIMIT
            listener = CourseListener(config.link.system_id)
            interview.listen = listener.hear
            while not turn() and time.monotonic() < until:
                pass
            await_course(interview, listener, turn)
    except LinkSettingError as error:
        return AutopilotReadings([failed(LINK, str(error))], heard=False)
    return replace(judged(config, url, interview), course=listener.missing)


def await_course(interview: Interview, listener: CourseListener, turn: Callable[[], bool]) -> None:
    """Ask for position and heading until they are known, for `COURSE_WITHIN` seconds at most."""
    began, asked_at = time.monotonic(), -math.inf
    while interview.autopilot and listener.missing and (now := time.monotonic()) < began + COURSE_WITHIN:
        if now - asked_at >= PATIENCE:
            interview.request(COURSE_MESSAGES, now)
            asked_at = now
        turn()


@contextmanager
def talking(
    config: Config, url: str, names: Callable[[int], Sequence[str]]
) -> Iterator[tuple[Interview, Callable[[], bool]]]:
    """Open `url`. Yields an interview, and what runs its turn and waits. Raises LinkSettingError."""
    address = read_url(url)
    check_installed(address)
    signing, began = _signing(config.link.signing_key), time.monotonic()
    connection = Connection(partial(open_transport, address), began)
    interview = Interview(connection, names, config.link.system_id, began, signing)
    interview.refuse_unsigned = not config.link.unsigned_autopilot

    def turn() -> bool:
        over = interview.turn(time.monotonic())
        readable = [number for number in (connection.fileno(),) if number is not None]
        select.select(readable, [], [], _TICK)
        return over

    try:
        yield interview, turn
    finally:
        connection.close()
        if signing is not None:
            signing.close()


def _signing(key: str | None) -> Signing | None:
    """Load the key, with timestamps in a temporary folder: the companion's own must not be changed."""
    if key is None:
        return None
    with TemporaryDirectory() as folder:
        return open_signing(Path(key), Path(folder))


def judged(config: Config, url: str, interview: Interview) -> AutopilotReadings:
    """Judge the results of an interview."""
    autopilot, values = interview.autopilot, interview.values
    if autopilot is None:
        return AutopilotReadings([failed(LINK, silence(url, interview))], heard=False)
    name = NAMES.get(autopilot.kind, f"autopilot of kind {autopilot.kind}")
    who = f"{name}, system {autopilot.system_id}"
    known = known_autopilot(autopilot.kind, autopilot.vehicle, config.call.px4_hold)
    grounds = tuple(sorted(interview.grounds))
    if known is None:
        never = f"{who}, vehicle type {autopilot.vehicle}: no ArduPilot or PX4 rover, never held"
        return AutopilotReadings([failed(CHECK, never)], url=url, grounds=grounds)
    if not values:
        mute = f"{who}: it answers none of our questions: check that the link goes both ways"
        return AutopilotReadings([failed(CHECK, mute)], overrun=known.overrun, url=url, grounds=grounds)
    offboard = config.call.px4_hold == "offboard"
    deadman = config.call.px4_deadman != "off"
    facts = Facts(
        values, autopilot.system_id, config.link.allowed_senders, offboard, config.call.policy, deadman
    )
    wrong = judge(autopilot.kind, facts, holds=config.call.holds)
    worst = max((one.verdict for one in wrong), default=Verdict.PASS)
    told = f"{len(wrong)} findings, below" if wrong else "none makes a hold unsafe"
    wrong.insert(0, CheckFinding(CHECK, worst, f"{who}: {len(values)} parameters told, {told}"))
    if autopilot.kind == PX4:
        wrong.append(warned(CHECK, _GUARDED if deadman else _UNGUARDED))
    elif deadman:
        wrong.append(warned(CHECK, _NOT_A_PX4))
    return AutopilotReadings(wrong, speed(autopilot.kind, values), known.overrun, url=url, grounds=grounds)


def silence(url: str, interview: Interview) -> str:
    """Explain why no autopilot was received, as far as it can be known, and what to check."""
    trouble = interview.connection.trouble
    if trouble is not None and "in use" in trouble:
        return f"{url}: {trouble}: is the companion running? Stop it, or give the check a --link of its own"
    if trouble is not None:
        return f"{url}: {trouble}: check [link] url"
    if interview.signing is not None and interview.signing.trouble is not None:
        return f"{url}: {interview.signing.trouble}"
    if any(component == COMPONENT_ID for _, component in interview.others):
        return f"{url}: a companion is heard, and no autopilot: check the router, or what sends to this link"
    if interview.others:
        heard = ", ".join(f"{system}/{component}" for system, component in sorted(interview.others)[:4])
        return f"{url}: {heard} heard, and no autopilot (component 1): check the router"
    if interview.bytes:
        return f"{url}: {interview.bytes} bytes heard that are no MAVLink: check baud rate and protocol"
    return f"{url}: nothing heard in {HEARD_WITHIN:.0f} s: check wiring, [link] url, and that it sends there"


class CourseListener:
    """Takes an autopilot's messages. missing: what was never known so far, as of `unknown`."""

    def __init__(self, system_id: int) -> None:
        self._tracker = VehicleTracker(system_id)
        self.missing = unknown(None, 0.0)

    def hear(self, message: Any, now: float) -> None:
        """Take a message of the autopilot."""
        tracker, system = self._tracker, message.get_srcSystem()
        match message.get_type():
            case "HEARTBEAT":
                tracker.heartbeat(system, message, now)
            case "GLOBAL_POSITION_INT":
                tracker.position(system, message, now)
            case "ATTITUDE":
                tracker.attitude(system, message, now)
        if self.missing:
            self.missing = unknown(tracker.vehicle, now)
