"""Routes frames between the autopilot's two ports, as ArduPilot does.

A route is a (system, component) from which a frame came in on a port. Messages without a target, or for
everyone, go to the other port; messages with a target go only to a port where that target has been heard.
Routes never expire. This module is pure: frames in, decisions out, no sockets.
"""

from __future__ import annotations

import enum
import struct
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

MAX_ROUTES = 20
EVERYONE = 0

# Messages that ArduPilot knows and passes on. All others are dropped, like those of a private dialect.
_PASSED = (
    "HEARTBEAT SYSTEM_TIME PING SET_MODE PARAM_REQUEST_READ PARAM_REQUEST_LIST PARAM_VALUE PARAM_SET "
    "GLOBAL_POSITION_INT ATTITUDE SYS_STATUS RC_CHANNELS_OVERRIDE MANUAL_CONTROL VFR_HUD RC_CHANNELS "
    "REQUEST_DATA_STREAM COMMAND_INT COMMAND_LONG COMMAND_ACK FILE_TRANSFER_PROTOCOL TIMESYNC "
    "AUTOPILOT_VERSION DISTANCE_SENSOR OBSTACLE_DISTANCE NAMED_VALUE_FLOAT NAMED_VALUE_INT STATUSTEXT "
    "PARAM_EXT_REQUEST_READ PARAM_EXT_REQUEST_LIST PARAM_EXT_VALUE PARAM_EXT_SET PARAM_EXT_ACK TUNNEL "
    "SET_POSITION_TARGET_LOCAL_NED CURRENT_MODE MESSAGE_INTERVAL "
    "MISSION_COUNT MISSION_REQUEST_LIST MISSION_REQUEST_INT MISSION_ITEM_INT MISSION_ACK MISSION_CURRENT "
    # Of cameras: not tried on a real autopilot, whose router passes what is in its dialect.
    "CAMERA_INFORMATION CAMERA_SETTINGS CAMERA_CAPTURE_STATUS STORAGE_INFORMATION "
    "VIDEO_STREAM_INFORMATION VIDEO_STREAM_STATUS CAMERA_TRACKING_IMAGE_STATUS"
)
PASSED_IDS = frozenset(int(getattr(mavlink, f"MAVLINK_MSG_ID_{name}")) for name in _PASSED.split())


class Port(enum.Enum):
    """The autopilot's two serial ports; the value is the name used in reports."""

    COMPANION = "companion"
    GCS = "gcs"

    @property
    def other(self) -> Port:
        return Port.GCS if self is Port.COMPANION else Port.COMPANION


@dataclass(frozen=True)
class FrameRoute:
    """A decision about one frame: pass it to the other port, execute it here, both or neither."""

    forward: bool
    execute: bool


DROPPED = FrameRoute(forward=False, execute=False)


class DatagramParser:
    """Parses datagrams one by one. A frame cut off at the end is dropped: it cannot harm the next."""

    def __init__(self) -> None:
        self.bad = 0

    def frames(self, datagram: bytes) -> list[Any]:
        """Returns the whole, correct frames of known ids in `datagram`; the rest is counted in `bad`."""
        mav = mavlink.MAVLink(None)
        mav.robust_parsing = True
        try:
            parsed = mav.parse_buffer(datagram) or []
        except (mavlink.MAVError, ValueError, IndexError, struct.error):
            self.bad += 1
            return []
        known = [frame for frame in parsed if frame.get_msgId() >= 0]
        self.bad += len(parsed) - len(known)
        return known


class Router:
    """Learns routes and decides about each frame. `system` and `component` are the autopilot's own ids."""

    def __init__(self, system: int = 1, component: int = 1) -> None:
        self._system = system
        self._component = component
        self._routes: list[tuple[int, int, Port]] = []

    def heard(self, port: Port) -> set[tuple[int, int]]:
        """Returns every (system, component) from which frames have come in on `port`."""
        return {(system, component) for system, component, at in self._routes if at is port}

    def decide(self, port: Port, frame: Any) -> FrameRoute:
        """Learns the sender of a frame that came in on `port` and decides what becomes of the frame."""
        sender = (frame.get_srcSystem(), frame.get_srcComponent())
        if sender == (self._system, self._component) or frame.get_msgId() not in PASSED_IDS:
            return DROPPED
        self._learn(*sender, port)
        # MANUAL_CONTROL calls it by another name, and MAVLink's routers know that.
        name = "target" if frame.get_type() == "MANUAL_CONTROL" else "target_system"
        system = int(getattr(frame, name, EVERYONE))
        component = int(getattr(frame, "target_component", EVERYONE))
        if (system, component) == (self._system, self._component):
            return FrameRoute(forward=False, execute=True)
        return FrameRoute(
            forward=self._is_beyond(port.other, system, component),
            execute=self._is_for_autopilot(system, component),
        )

    def _learn(self, system: int, component: int, port: Port) -> None:
        route = (system, component, port)
        if system != EVERYONE and route not in self._routes and len(self._routes) < MAX_ROUTES:
            self._routes.append(route)

    def _is_beyond(self, port: Port, system: int, component: int) -> bool:
        if system == EVERYONE:
            return True
        # Within the own system the component counts; another system is reached by a route to any component of
        # it.
        by_component = system == self._system and component != EVERYONE
        return any(
            (system, component) == known if by_component else system == known[0] for known in self.heard(port)
        )

    def _is_for_autopilot(self, system: int, component: int) -> bool:
        """Whether the autopilot executes a frame with this target.

        ArduPilot up to 4.6 also executes frames for a component of its system that it has not heard yet. This
        simulation does not do that; it would be added here.
        """
        return system in (EVERYONE, self._system) and component in (EVERYONE, self._component)
