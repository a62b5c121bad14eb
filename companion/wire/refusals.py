"""Lists why the companion refuses requests: the counters' names, and what the requester is sent."""

from __future__ import annotations

from typing import Literal

Rejected = Literal[
    "sender",
    "rate",
    "repeated",
    "target",
    "payload",
    "version",
    "parts",
    "command",
    "unknown parameter",
    "range",
    "read-only",
    "file queue",
    "unsigned",
    "signature",
    "replay",
    "ahead",
    "echo",
    "clash",
    "no autopilot for modes",
]
"""Keys of `rejected` in the status file."""

COUNTED: dict[Rejected, str] = {
    "sender": "a change by a system id outside `allowed_senders`: DENIED and a text",
    "rate": "more than [its share](#requests-a-second)",
    "repeated": "the same request on another connection within a second: the first one's reply",
    "target": "a request to system or component 0, but for reading parameters",
    "payload": "an impossible TUNNEL or file transfer payload",
    "version": "an answer of another version: a text",
    "parts": "too many parts, or parts that contradict each other: 45004 REFUSED",
    "command": "31010 with parameters that say nothing: DENIED and a text",
    "unknown parameter": "a name or index that is not listed: PARAM_ERROR, or PARAM_EXT_ACK FAILED",
    "range": "a value out of range: the old value and a text",
    "read-only": "setting what can only be read: the old value and a text",
    "file queue": "a file request while 8 replies wait",
    "unsigned": "no signature, where a key is set",
    "signature": "a signature of another key",
    "replay": "a signed frame that is not newer",
    "ahead": "a signed frame far ahead of the clock",
    "echo": "a frame of our own that came back",
    "clash": "a frame under our ids that is not ours: a text on the other connections",
    "no autopilot for modes": "a hold without a known autopilot",
}
"""Counter -> what was refused, and what its sender gets, if anything."""
