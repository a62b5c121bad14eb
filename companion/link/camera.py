"""Acts as a MAVLink camera beside the companion: tells where its video is, and takes taps in it.

MAVLink calls a tap "tracking" (Camera Protocol v2, MAV_CMD_CAMERA_TRACK_POINT and _RECTANGLE).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from anytraverse.regions import Box
from companion.config.video import CameraSettings
from companion.link import camera_messages, encode
from companion.link.access_control import AccessControl
from companion.link.alerts import TextSender
from companion.link.answer_store import SenderCache
from companion.link.answers import TRACKING, AnswerService
from companion.link.outbox import Outbox
from companion.wire import notices
from companion.wire.answers import Answer, Via
from companion.wire.ids import WARNING, SenderId
from companion.wire.messages import MESSAGES

SMALLEST = 0.02
"""The least width and height of a tapped box, as shares of the picture: a smaller one is no thing."""
_PERIOD = MESSAGES["camera heartbeat"].period or 1.0
_SILENT_FOR = 5.0
"""s for which the camera is silent after another component used its ids."""
_REPEATED_WITHIN = 10.0
_MOST_SENDERS = 16
_FASTEST, _SLOWEST = 0.5, 10.0
"""s between two CAMERA_TRACKING_IMAGE_STATUS. All who asked get them as the last one asked."""
_MOST_ASKERS = 4
_IDLE_REPEATS = 3
_NEVER = float("-inf")
_VIAS = {command: via for via, command in TRACKING.items()}
_OLDER: dict[int, int] = {
    mavlink.MAV_CMD_REQUEST_CAMERA_INFORMATION: mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION,
    mavlink.MAV_CMD_REQUEST_CAMERA_SETTINGS: mavlink.MAVLINK_MSG_ID_CAMERA_SETTINGS,
    mavlink.MAV_CMD_REQUEST_STORAGE_INFORMATION: mavlink.MAVLINK_MSG_ID_STORAGE_INFORMATION,
    mavlink.MAV_CMD_REQUEST_CAMERA_CAPTURE_STATUS: mavlink.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS,
    mavlink.MAV_CMD_REQUEST_VIDEO_STREAM_INFORMATION: mavlink.MAVLINK_MSG_ID_VIDEO_STREAM_INFORMATION,
    mavlink.MAV_CMD_REQUEST_VIDEO_STREAM_STATUS: mavlink.MAVLINK_MSG_ID_VIDEO_STREAM_STATUS,
}
"""The commands that were before REQUEST_MESSAGE, and what they ask for."""
_FIXED: dict[int, tuple[str, Callable[[], Any]]] = {
    mavlink.MAVLINK_MSG_ID_CAMERA_SETTINGS: ("camera settings", camera_messages.settings),
    mavlink.MAVLINK_MSG_ID_STORAGE_INFORMATION: ("camera storage", camera_messages.no_storage),
    mavlink.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS: ("capture status", camera_messages.no_capture),
}
_OF_STREAM = (mavlink.MAVLINK_MSG_ID_VIDEO_STREAM_INFORMATION, mavlink.MAVLINK_MSG_ID_VIDEO_STREAM_STATUS)
_OF_VIDEO = (mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION, *_OF_STREAM)
_ACCEPTED: int = mavlink.MAV_RESULT_ACCEPTED
_DENIED: int = mavlink.MAV_RESULT_DENIED
_LATER: int = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
_UNSUPPORTED: int = mavlink.MAV_RESULT_UNSUPPORTED


Tapped = Box | tuple[float, float]
"""What was tapped in the video: a box, or a point x, y; shares of the picture."""
Resolver = Callable[[Tapped, float], "Answer | str"]
"""Makes an answer, yet without sender and message, of what was tapped, or says why it changes nothing."""


class CameraService:
    """Answers the commands of the camera protocol. Any sender may read; only allowed senders may tap.

    It is heard once it has a picture and a video.

    url: where the video is, "" while it is nowhere. size: its height and width, None until a frame came.
    resolve: makes an answer of a tap.
    """

    def __init__(
        self,
        outbox: Outbox,
        text_sender: TextSender,
        access: AccessControl,
        answers: AnswerService,
        settings: CameraSettings | None,
    ) -> None:
        """settings: None where the companion is no camera."""
        self._outbox = outbox
        self._text_sender = text_sender
        self._access = access
        self._answers = answers
        self._settings = settings
        self.url = ""
        self.size: tuple[int, int] | None = None
        self.resolve: Resolver = lambda _tap, _now: "the companion is starting: tap again"
        self._heartbeat_at = self._conflict_at = self._status_at = _NEVER
        self._conflict = False
        self._answered: SenderCache[tuple[Answer, float]] = SenderCache(1, _MOST_SENDERS)
        """Each sender's newest tap that became an answer, and when it came."""
        self._target: Box | None = None
        self._status_period = math.inf
        self._askers: list[SenderId] = []
        """Who is sent CAMERA_TRACKING_IMAGE_STATUS: on their connections alone, as a radio is slow."""
        self._idle_left = 0

    @property
    def component(self) -> int:
        """The component id, 0 where the companion is no camera."""
        return self._settings.component if self._settings is not None else 0

    def mark(self, target: Box | None) -> None:
        """Set what CAMERA_TRACKING_IMAGE_STATUS says is tapped, which ground stations draw; None: nothing."""
        if target != self._target:
            self._target, self._status_at = target, _NEVER
            self._idle_left = _IDLE_REPEATS

    def note_id_conflict(self, now: float) -> None:
        """Note that another component sent under the camera's ids: it is silent for some seconds."""
        if not self._conflict:
            self._text_sender.send(notices.camera_id_taken(self.component), WARNING, now)
        self._conflict, self._conflict_at = True, now

    def receive(self, sender: SenderId, message: Any, now: float) -> Answer | None:
        """Take a COMMAND_LONG or COMMAND_INT for the camera; return the answer that a tap means."""
        if self._settings is None or self._conflict:
            return None
        first, command = message.param1, message.command
        match command:
            case mavlink.MAV_CMD_CAMERA_TRACK_POINT | mavlink.MAV_CMD_CAMERA_TRACK_RECTANGLE:
                return self._tapped(sender, message, now)
            case mavlink.MAV_CMD_REQUEST_MESSAGE:
                result = self._send(first, sender, now)
            case _ if command in _OLDER:
                result = self._send(_OLDER[command], sender, now)
            case mavlink.MAV_CMD_SET_MESSAGE_INTERVAL if self._allowed(sender, now):
                result = self._set_interval(first, message.param2, sender)
            case mavlink.MAV_CMD_CAMERA_STOP_TRACKING if self._allowed(sender, now):
                # What a tap taught stays: only an operator's "forget" takes it back.
                self.mark(None)
                result = _ACCEPTED
            case mavlink.MAV_CMD_SET_MESSAGE_INTERVAL | mavlink.MAV_CMD_CAMERA_STOP_TRACKING:
                result = _DENIED
            case mavlink.MAV_CMD_VIDEO_START_STREAMING | mavlink.MAV_CMD_VIDEO_STOP_STREAMING:
                # The video is there for whoever asks its address, and costs nothing while nobody does.
                result = _ACCEPTED if first in (0, camera_messages.STREAM) else _DENIED
            case _:
                result = _UNSUPPORTED
        self._acknowledge(command, result, sender, now)
        return None

    def tick(self, now: float) -> None:
        """Queue the heartbeat and the tracking status when they are due."""
        if self._settings is None:
            return
        if self._conflict and now - self._conflict_at > _SILENT_FOR:
            self._conflict = False
        if self._conflict:
            return
        # Some ground stations ask once, when they first hear the camera.
        if self.url and self.size is not None and now - self._heartbeat_at >= _PERIOD:
            self._heartbeat_at = now
            self._outbox.push("camera heartbeat", camera_messages.heartbeat(), now, key=0, lifetime=1.0)
        due = math.isfinite(self._status_period) and now - self._status_at >= self._status_period
        if due and (self._target is not None or self._idle_left):
            self._status_at = now
            self._idle_left = _IDLE_REPEATS if self._target is not None else self._idle_left - 1
            for asker in self._askers:
                status = camera_messages.tracking_status(self._target)
                self._outbox.push("tracking status", status, now, key=asker, lifetime=1.0, to=asker)

    def _tapped(self, sender: SenderId, message: Any, now: float) -> Answer | None:
        via = _VIAS[message.command]
        if not self._allowed(sender, now):
            self._acknowledge(message.command, _DENIED, sender, now)
            return None
        key = (sender, via, message.param1, message.param2, message.param3, message.param4)
        # The call that a repeated tap meant may be closed by the answer that the first one was.
        known = self._answered.get(key) if getattr(message, "confirmation", 0) else None
        if known is not None and now - known[1] <= _REPEATED_WITHIN:
            return self._answers.admit(replace(known[0], confirmation=message.confirmation), now)
        tapped = read_tap(via, message)
        if tapped is None:
            self._access.rejected["command"] += 1
            self._acknowledge(message.command, _DENIED, sender, now)
            return None
        resolved = self.resolve(tapped, now)
        if isinstance(resolved, str):
            self._text_sender.refuse(resolved, now)
            self._acknowledge(message.command, _LATER, sender, now)
            return None
        answer = replace(resolved, sender=sender, via=via)
        self._answered.put(key, (answer, now))
        return self._answers.admit(answer, now)

    def _allowed(self, sender: SenderId, now: float) -> bool:
        return self._access.permits(sender, now, self._text_sender.refuse_sender)

    def _send(self, message_id: float, to: SenderId, now: float) -> int:
        """Send the message of this id once; return the MAV_RESULT."""
        if message_id == mavlink.MAVLINK_MSG_ID_CAMERA_TRACKING_IMAGE_STATUS:
            row, message = "tracking status", camera_messages.tracking_status(self._target)
        elif message_id in _FIXED:
            row, make = _FIXED[int(message_id)]
            message = make()
        elif message_id not in _OF_VIDEO:
            return _UNSUPPORTED
        elif self._settings is None or self.size is None or (not self.url and message_id in _OF_STREAM):
            return _LATER
        elif message_id == mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION:
            row, message = "camera information", camera_messages.information(self.size)
        elif message_id == mavlink.MAVLINK_MSG_ID_VIDEO_STREAM_INFORMATION:
            message = camera_messages.stream_information(self._settings, self.size, self.url)
            row = "stream information"
        else:
            row, message = "stream status", camera_messages.stream_status(self._settings, self.size)
        self._outbox.push(row, message, now, key=to, to=to)
        if row == "camera information":
            # MAVSDK 4.1 does not always ask for it.
            self._send(mavlink.MAVLINK_MSG_ID_VIDEO_STREAM_INFORMATION, to, now)
        return _ACCEPTED

    def _set_interval(self, message_id: float, interval: float, sender: SenderId) -> int:
        if message_id != mavlink.MAVLINK_MSG_ID_CAMERA_TRACKING_IMAGE_STATUS:
            return _UNSUPPORTED
        others = [asker for asker in self._askers if asker != sender]
        if interval == -1:
            self._askers = others
        elif math.isfinite(interval) and interval >= 0:
            seconds = interval / 1e6 or 1.0
            self._status_period, self._idle_left = min(max(seconds, _FASTEST), _SLOWEST), _IDLE_REPEATS
            self._askers = [*others, sender][-_MOST_ASKERS:]
        else:
            return _DENIED
        return _ACCEPTED

    def _acknowledge(self, command: int, result: int, sender: SenderId, now: float) -> None:
        self._outbox.push("camera ack", encode.command_ack(command, result, sender), now, to=sender)


def read_tap(via: Via, message: Any) -> Tapped | None:
    """Read the parameters of a tracking command; None where they are no place in the picture."""
    sides: tuple[float, ...] = (message.param1, message.param2, message.param3, message.param4)
    if via is Via.TRACK_POINT:
        x, y = sides[:2]
        return (x, y) if _share(x) and _share(y) else None
    if not all(map(_share, sides)):
        return None
    left, right = sorted((sides[0], sides[2]))
    top, bottom = sorted((sides[1], sides[3]))
    if right - left < SMALLEST or bottom - top < SMALLEST:
        return (left + right) / 2, (top + bottom) / 2
    return Box(left, top, right, bottom)


def _share(value: float) -> bool:
    return 0.0 <= value <= 1.0
