"""Lists the ports that MAVLink may be on, and listens who is there."""

from __future__ import annotations

import select
import time
from functools import partial
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.config.link_settings import LinkSettingError, read_url
from companion.desk.check.interview import NAMES
from companion.link.connection import Connection
from companion.link.parser import Parser
from companion.link.transport import check_installed, open_transport
from companion.pages.requests import RequestError
from companion.wire.ids import AUTOPILOT_COMPONENT_ID

LONGEST = 6.0
"""Seconds for which is listened at most."""
_AFTER = 1.5
"""Seconds for which others are waited for, once an autopilot was heard: one heartbeat, and half."""
_MOST = 32
_TICK = 0.05
_COMPONENT = 194
"""As `companion check` names itself."""
_USUAL = ("udpin:127.0.0.1:14550", "udpin:0.0.0.0:14550", "udpout:127.0.0.1:14550", "tcp:127.0.0.1:5760")
_BY_ID = Path("/dev/serial/by-id")


def ports() -> list[dict[str, str]]:
    """Return urls to try, and what each is: the serial ports that exist, then the usual addresses."""
    found = []
    try:
        from serial.tools.list_ports import comports

        named = {str(path.resolve()): str(path) for path in _BY_ID.glob("*")} if _BY_ID.is_dir() else {}
        for port in comports():
            what = port.description if port.description not in ("", "n/a") else "serial port"
            found.append({"url": f"serial:{named.get(port.device, port.device)}", "what": what})
    except ImportError:
        pass
    about = ("from a router on this computer", "from the network", "to a router here", "to a program here")
    return found + [{"url": url, "what": what} for url, what in zip(_USUAL, about, strict=True)]


def listen(url: str, seconds: float = LONGEST) -> dict[str, Any]:
    """Listen for heartbeats. Returns who was heard, as JSON values. Raises RequestError for a wrong url.

    Nothing is sent, but to udpout: nobody there knows where to send before a first heartbeat of ours.
    """
    try:
        address = read_url(url)
        check_installed(address)
    except LinkSettingError as error:
        raise RequestError(str(error)) from error
    began = time.monotonic()
    connection = Connection(partial(open_transport, address), began)
    parser, heard, count, others = Parser(), dict[tuple[int, int], dict[str, Any]](), 0, 0
    until, beat_at = began + seconds, -1.0
    try:
        while (now := time.monotonic()) < until and len(heard) < _MOST:
            while data := connection.read(now):
                count += len(data)
                for message in parser.feed(data, now, whole=connection.datagrams):
                    if message.get_type() != "HEARTBEAT":
                        others += 1
                    else:
                        who = message.get_srcSystem(), message.get_srcComponent()
                        if who not in heard and who[1] == AUTOPILOT_COMPONENT_ID:
                            until = min(until, now + _AFTER)
                        heard[who] = _shown(who, message)
                if time.monotonic() >= until:
                    break
            if address.scheme == "udpout" and now - beat_at >= 1.0:
                beat_at = now
                connection.write(_heartbeat(), now)
            readable = [number for number in (connection.fileno(),) if number is not None]
            select.select(readable, [], [], _TICK)
    finally:
        connection.close()
    found = sorted(heard.values(), key=lambda one: (not one["is_autopilot"], one["system"], one["component"]))
    return {
        "url": url,
        "heard": found,
        "bytes": count,
        "seconds": round(time.monotonic() - began, 1),
        "problem": _problem(found, others, count, connection.trouble, seconds),
    }


def _problem(
    found: list[dict[str, Any]], others: int, count: int, trouble: str | None, seconds: float
) -> str:
    autopilots = sum(one["is_autopilot"] for one in found)
    if autopilots:
        several = f"{autopilots} autopilots: the companion takes that with [link] system_id, else the first."
        return several if autopilots > 1 else ""
    if trouble:
        busy = " Does the companion run, or another program? Stop it." if "in use" in trouble else ""
        return f"The port cannot be used: {trouble}.{busy}"
    if found:
        return "No autopilot is heard here, only these."
    if others:
        return f"{others} messages came, and no heartbeat: does another program have this link?"
    if count:
        return f"{count} bytes came that are no MAVLink: another baud rate, or another protocol?"
    return f"Nothing came in {seconds:.0f} s: is it wired and powered, and does it send to this address?"


def _shown(who: tuple[int, int], message: Any) -> dict[str, Any]:
    is_autopilot = who[1] == AUTOPILOT_COMPONENT_ID and message.autopilot != mavlink.MAV_AUTOPILOT_INVALID
    return {
        "system": who[0],
        "component": who[1],
        "type": _name("MAV_TYPE", message.type),
        "autopilot": _autopilot(message.autopilot) if is_autopilot else "",
        "is_autopilot": is_autopilot,
    }


def _autopilot(number: int) -> str:
    return NAMES.get(int(number)) or _name("MAV_AUTOPILOT", number)


def _name(enum: str, number: int) -> str:
    entry = mavlink.enums[enum].get(int(number))
    return (
        f"number {number}" if entry is None else entry.name.removeprefix(f"{enum}_").replace("_", " ").lower()
    )


def _heartbeat() -> bytes:
    mav = mavlink.MAVLink(None, 1, _COMPONENT)
    kind, none = mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID
    beat = mavlink.MAVLink_heartbeat_message(kind, none, 0, 0, mavlink.MAV_STATE_ACTIVE, 3)
    return bytes(beat.pack(mav))
