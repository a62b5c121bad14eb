"""Serves the items of the simulated mission, as ArduPilot does: single ones also without a list request."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.sim.field.mission import SimulatedMission
from companion.sim.field.telemetry import degrees_e7

MISSION = int(mavlink.MAV_MISSION_TYPE_MISSION)
FOR_EVER = -1
"""Repeats of a jump."""
HOME_FRAME = int(mavlink.MAV_FRAME_GLOBAL)
ITEM_FRAME = int(mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)


def replies(tour: SimulatedMission, request: Any) -> list[Any]:
    """Returns the answers to MISSION_REQUEST_LIST or MISSION_REQUEST_INT, none to anything else.

    A request for an item that is not there is answered by the number of items, and refused.
    """
    to = (request.get_srcSystem(), request.get_srcComponent())
    kind = request.get_type()
    if kind not in ("MISSION_REQUEST_LIST", "MISSION_REQUEST_INT"):
        return []
    if request.mission_type != MISSION:
        refused = mavlink.MAV_MISSION_UNSUPPORTED
        return [mavlink.MAVLink_mission_ack_message(*to, refused, request.mission_type)]
    count = mavlink.MAVLink_mission_count_message(*to, tour.count, MISSION)
    if kind == "MISSION_REQUEST_LIST":
        return [count]
    item = tour.item(request.seq)
    if item is None:
        refused = mavlink.MAV_MISSION_INVALID_SEQUENCE
        return [count, mavlink.MAVLink_mission_ack_message(*to, refused, MISSION)]
    jumps = item.command == mavlink.MAV_CMD_DO_JUMP
    latitude, longitude = (0, 0) if jumps else degrees_e7(item.x, item.y)
    return [
        mavlink.MAVLink_mission_item_int_message(
            *to,
            request.seq,
            HOME_FRAME if jumps or request.seq < tour.counts_from else ITEM_FRAME,
            item.command,
            0,
            1,
            float(item.jump),
            float(FOR_EVER if jumps else 0),
            0.0,
            0.0,
            latitude,
            longitude,
            0.0,
            MISSION,
        )
    ]
