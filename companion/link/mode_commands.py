"""Sends mode commands: as requests to the script on the autopilot where it runs, else as DO_SET_MODE.

The script compares before it sets a mode, so that a human who was faster is not overridden. DO_SET_MODE sets
the mode whatever it was.
"""

from __future__ import annotations

import logging
import random
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.calls.mode_monitor import ModeAnswer
from companion.guide.rules import TAKEN_WITHIN, GuideAnswer
from companion.link import encode
from companion.link.access_control import AccessControl
from companion.link.outbox import Outbox
from companion.link.vehicle import VehicleTracker
from companion.vehicle import Autopilot, known_autopilot
from companion.vehicle.ardupilot import AUTO, GUIDED
from companion.vehicle.state import Vehicle
from companion.wire.ids import AUTOPILOT_COMPONENT_ID, MODE_REQUEST_COMMAND
from companion.wire.messages import MESSAGES

log = logging.getLogger(__name__)

LIFETIME = 1.0
"""s that a mode command may wait to be sent: later it may no longer be right."""
HOLD_UNANSWERED, LONGEST_UNANSWERED = 0.3, 2.0
"""s after which a hold that the script has not answered goes as DO_SET_MODE: at least, and at most."""
SCRIPT_LATER = 0.1
"""s by which the script's answer may come later than earlier ones: it runs every 0.1 s."""
FIRST_ROUND_TRIP = 0.5
_SHORTEST, _LONGEST = 0.02, 3.0
"""s. Round trip of a command and its answer: assumed before the first one; limits of a measured one."""
_ANSWERED_WITHIN = 5.0
"""s after which a command counts as lost, so that a later answer is not taken for its own."""
_MAX_UNANSWERED = 8
GUIDE_ID = 1 << 16
"""By which the script knows requests to guide, in place of a hold's id, which has 16 bits."""
_SERIALS = 1 << 24
"""Serial numbers of requests: a parameter of a command is a float, which holds whole numbers up to here."""
_ACCEPTED: int = mavlink.MAV_RESULT_ACCEPTED
_CHANGED: int = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
_DENIED: int = mavlink.MAV_RESULT_DENIED
_TAKEN = frozenset({_CHANGED, _DENIED})
"""Answers of the script where somebody else has set the mode that stands."""
_UNSUPPORTED: int = mavlink.MAV_RESULT_UNSUPPORTED
_IN_PROGRESS: int = mavlink.MAV_RESULT_IN_PROGRESS


class _Script(Enum):
    """What is known of the script on the autopilot. Once it was heard, nothing resumes past it."""

    UNKNOWN = "unknown"
    ABSENT = "absent"
    HEARD = "heard"


@dataclass
class _Sent:
    """A command that waits for its answer. mode: None where that tells nothing but that the script is there.

    serial: of a request to the script, 0 for DO_SET_MODE, whose answer names none. hold: id of the hold.
    row, message: of the message table. left: it was sent, and waits for its answer since `at`.
    brakes: the script may brake for it first, so that its last answer tells no round trip.
    """

    mode: int | None
    serial: int
    at: float
    hold: int = 0
    row: str = ""
    message: Any = None
    left: bool = False
    brakes: bool = False


def _is_mavlink_1(message: Any) -> bool:
    return bool(message.get_msgbuf()[0] == mavlink.PROTOCOL_MARKER_V1)


class ModeCommands:
    """Sends mode commands, one at a time: the newest replaces one that waits.

    round_trip: seconds from a command to its answer, as measured; it rises at once and falls slowly.
    brake: seconds for which the script may brake before it holds, which each request tells it; 0: not at all.
    """

    def __init__(self, outbox: Outbox, access: AccessControl, tracker: VehicleTracker) -> None:
        self._outbox = outbox
        self._access = access
        self._tracker = tracker
        self._script = _Script.UNKNOWN
        self._returns = 0
        self._asked_at: float | None = None
        self._unanswered: list[_Sent] = []
        self._newest_hold = 0
        """The id of the hold that was commanded or ended last."""
        self._hold: _Sent | None = None
        """The hold that goes as DO_SET_MODE unless the script answers it. at: of its first request."""
        self._script_takes = 0.0
        self._guiding: int | None = None
        """Serial number of the request for GUIDED that the script has granted: its last answer ends that."""
        # The script answers each serial once, also one of before a restart of the companion.
        self._serial = random.randrange(1, _SERIALS)
        self.round_trip = FIRST_ROUND_TRIP
        self.brake = 0.0

    @property
    def compares(self) -> bool:
        """Whether the script on the autopilot was heard: it compares the mode before it sets one."""
        return self._script is _Script.HEARD

    @property
    def takes_resume(self) -> bool:
        """Whether a resume is sent.

        Not before it is known whether the script is there, nor while another component uses our ids.
        """
        vehicle, autopilot = self._known()
        if vehicle is None or autopilot is None or (autopilot.scripted and self._script is _Script.UNKNOWN):
            return False
        return self._outbox.takes("resume", (vehicle.system_id, AUTOPILOT_COMPONENT_ID))

    @property
    def resume_waits(self) -> bool:
        """Whether a resume waits to be sent."""
        return self._outbox.waits("resume")

    def command(self, mode: int, now: float, *, expected: int | None = None, hold: int = 0) -> None:
        """Command a mode, before all other messages; it is dropped when it cannot be sent within 1 s.

        expected: the mode that this was decided on, None to set `mode` whatever stands. hold: id of the hold.
        A resume is only sent where `takes_resume` says so, and never past a script that was heard. Without a
        known autopilot the command is counted as rejected.
        """
        vehicle, autopilot = self._known()
        if vehicle is None or autopilot is None:
            self._access.rejected["no autopilot for modes"] += 1
            return
        before, self._newest_hold = self._hold, hold
        self.cancel()
        resumes = mode in autopilot.holdable
        if resumes and not self.takes_resume:
            return
        if self.compares and expected is not None:
            sent = self._request(vehicle, "resume" if resumes else "hold", mode, expected, hold, now)
            sent.brakes = self.brake > 0.0 and not resumes and expected in autopilot.mission_modes
            again = before is not None and (before.mode, before.hold) == (mode, hold)
            self._hold = None if resumes else replace(sent, at=before.at) if before and again else sent
        elif not (resumes and self.compares):
            self._set_mode(vehicle, autopilot, mode, hold, now)

    def guide(self, mode: int, expected: int, now: float) -> None:
        """Request a mode to drive the vehicle round something, or to end that. Only the script sets it."""
        vehicle, _ = self._known()
        if vehicle is not None and self.compares:
            # The script guides whom the heartbeat before said it of, and a request would leave before that.
            self._outbox.send_now("heartbeat", now)
            # One that left later than it may show would only be in the way of the hold that follows.
            self._request(vehicle, "guide", mode, expected, GUIDE_ID, now, lifetime=TAKEN_WITHIN / 2)

    def send_hold_now(self, now: float) -> None:
        """Send a queued hold command at once, not with the next `Link.tick`."""
        self._outbox.send_now("hold", now)

    def cancel(self) -> None:
        """Drop a mode command that waits, and expect no answer to it."""
        self._hold = None
        self._outbox.forget("hold")
        self._outbox.forget("resume")
        self._outbox.forget("guide")
        self._note_sent()

    def tick(self, now: float) -> None:
        """Ask whether the script is there, and send a hold that it has not answered as DO_SET_MODE."""
        self._note_sent()
        vehicle, autopilot = self._known()
        if vehicle is None or autopilot is None:
            return
        if self._tracker.returns != self._returns:  # it may have rebooted, with another script or none
            self._returns, self._script, self._asked_at = self._tracker.returns, _Script.UNKNOWN, None
        hold = self._hold
        if hold is not None and hold.brakes and vehicle.custom_mode == autopilot.brake_mode:
            # It brakes, and the answer was lost, or a human has set that mode: only the script knows.
            self._hold = None
        elif hold is not None and hold.mode is not None and now - hold.at >= self._patience:
            mode = hold.mode
            self.cancel()
            for request in self._unanswered:
                if request.row == "hold" and request.serial:
                    request.mode = None  # the script may answer that the HOLD which it finds is not its own
            self._set_mode(vehicle, autopilot, mode, hold.hold, now)
            self.send_hold_now(now)
        period = (MESSAGES["script"].period or 0.0) if self._script is not _Script.UNKNOWN else 1.0
        if autopilot.scripted and (self._asked_at is None or now - self._asked_at >= period):
            self._asked_at = now
            self._request(vehicle, "script", None, 0, 0, now)

    def answered(self, message: Any, now: float) -> ModeAnswer | GuideAnswer | None:
        """Take a COMMAND_ACK of our autopilot to us; return what it answers, None where that is no mode."""
        if message.command not in (mavlink.MAV_CMD_DO_SET_MODE, MODE_REQUEST_COMMAND):
            return None
        self._note_sent()
        by_script = message.command == MODE_REQUEST_COMMAND
        serial = message.result_param2 if by_script else 0
        if by_script and serial and serial == self._guiding:
            self._guiding = serial if message.result == _IN_PROGRESS else None
            return GuideAnswer(GUIDED, None) if message.result in _TAKEN else None
        sent = self._take_sent(serial, now, by_script=by_script)
        if by_script and sent is not None:
            # Our script names the serial number, where MAVLink 1 does not cut it off.
            ours = message.result != _UNSUPPORTED and (serial or _is_mavlink_1(message))
            self._script = _Script.HEARD if ours or self.compares else _Script.ABSENT
        if sent is None:
            return None
        if sent.hold == GUIDE_ID:
            return self._guide_answered(sent, int(message.result), now)
        before = self._hold
        if before is not None and by_script and (sent.hold, sent.mode) == (before.hold, before.mode):
            self._hold = None
        brakes = by_script and message.result == _IN_PROGRESS
        if brakes or not sent.brakes:
            self._measure(min(max(now - sent.at, _SHORTEST), _LONGEST), by_script=by_script)
        if brakes:
            sent.at, sent.brakes = now, True
            self._unanswered.append(sent)  # the last answer follows
        autopilot = self._known()[1]
        doubtful = not by_script and autopilot is not None and autopilot.contradicts_itself
        if sent.mode is None or doubtful or sent.hold != self._newest_hold:
            return None
        accepted = brakes or message.result == _ACCEPTED
        if not accepted:
            log.info("the autopilot says no to mode %d: MAV_RESULT %d", sent.mode, message.result)
        refusals = _TAKEN if sent.row == "hold" else {_DENIED}
        # It brakes out of a mission alone, also where the hold was decided on the GUIDED of its brake.
        out_of = min(autopilot.mission_modes, default=None) if brakes and autopilot is not None else None
        return ModeAnswer(sent.mode, accepted, by_script and message.result in refusals, out_of)

    def _guide_answered(self, sent: _Sent, result: int, now: float) -> GuideAnswer | None:
        if sent.mode is None:
            return None
        self._measure(min(max(now - sent.at, _SHORTEST), _LONGEST), by_script=True)
        if result == _IN_PROGRESS:
            self._guiding = sent.serial
        if sent.mode == AUTO and result == _ACCEPTED:
            self._tracker.mode_was_set(AUTO, now)
        return GuideAnswer(sent.mode, None if result in _TAKEN else result in (_ACCEPTED, _IN_PROGRESS))

    def _measure(self, seconds: float, *, by_script: bool) -> None:
        if by_script:
            self._script_takes = max(seconds, self._script_takes + (seconds - self._script_takes) / 8)
        self.round_trip = max(seconds, (self.round_trip + seconds) / 2)

    @property
    def _patience(self) -> float:
        """s that a hold waits for the script's answer before it is sent as DO_SET_MODE.

        No answer may be on its way then: DO_SET_MODE overrides a human who was faster than the hold.
        """
        return min(max(HOLD_UNANSWERED, self._script_takes + SCRIPT_LATER), LONGEST_UNANSWERED)

    def _known(self) -> tuple[Vehicle | None, Autopilot | None]:
        vehicle = self._tracker.vehicle
        return vehicle, known_autopilot(vehicle.autopilot, vehicle.type) if vehicle is not None else None

    def _set_mode(self, vehicle: Vehicle, autopilot: Autopilot, mode: int, hold: int, now: float) -> None:
        row = "resume" if mode in autopilot.holdable else "hold"
        message = encode.set_mode(vehicle.system_id, autopilot.command(mode), hold)
        self._push(row, message, _Sent(mode, 0, now, hold), vehicle)

    def _request(
        self,
        vehicle: Vehicle,
        row: str,
        mode: int | None,
        expected: int,
        hold: int,
        now: float,
        *,
        lifetime: float = LIFETIME,
    ) -> _Sent:
        self._serial = self._serial % (_SERIALS - 1) + 1
        sent = _Sent(mode, self._serial, now, hold)
        message = encode.mode_request(vehicle.system_id, hold, expected, mode or 0, sent.serial, self.brake)
        self._push(row, message, sent, vehicle, lifetime)
        return sent

    def _push(
        self, row: str, message: Any, sent: _Sent, vehicle: Vehicle, lifetime: float = LIFETIME
    ) -> None:
        sent.row, sent.message = row, message
        self._unanswered = [*self._unanswered, sent][-_MAX_UNANSWERED:]
        to = (vehicle.system_id, AUTOPILOT_COMPONENT_ID)
        self._outbox.push(row, message, sent.at, lifetime=lifetime, to=to)

    def _note_sent(self) -> None:
        """Note which commands have left. Those that were dropped get no answer."""
        for sent in [one for one in self._unanswered if not one.left]:
            left_at = self._outbox.sent_at(sent.row, sent.message)
            if left_at is not None:
                sent.left, sent.at = True, left_at
            elif not self._outbox.waits(sent.row):
                self._unanswered.remove(sent)

    def _take_sent(self, serial: int, now: float, *, by_script: bool) -> _Sent | None:
        """Return the command that is answered: by its serial number, or the oldest of its kind without one.

        DO_SET_MODE is answered without one, as is all over MAVLink 1. Where commands of several modes wait
        for such an answer, it is not known which of them it answers, as one may have been lost.
        """
        left = [one for one in self._unanswered if one.left and now - one.at <= _ANSWERED_WITHIN]
        fitting = [one for one in left if bool(one.serial) is by_script and serial in (0, one.serial)]
        if not fitting:
            return None
        self._unanswered.remove(fitting[0])
        return fitting[0] if len({one.mode for one in fitting}) == 1 else None
