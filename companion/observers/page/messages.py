"""Defines what supervisor and web process say to each other, as `Datagram`s.

The web process talks to browsers, so the supervisor believes nothing that it says but that it lives, that
somebody watches, and, where the page has a token, the bytes of an answer, which the link checks, and changes
of settings, which are checked as if a stranger asked.
"""

from __future__ import annotations

from enum import Enum

from companion.wire.answers import MAX_PAYLOAD


class PageMessageKind(bytes, Enum):
    """What is told to the web process."""

    SETUP = b"c"
    """The first message: folder, token_hash, own_address: where only this computer reaches it, else "", and
    ground: the `GroundLine`s of the mount, which the page lays over the live picture."""
    NEWS = b"n"
    """The documents status, state and check, `told`: what the ground is told, `ahead`: of `Status.ahead`,
    and `at`: when it was so."""
    ACKNOWLEDGEMENT = b"k"
    """payload: of a TUNNEL 45004, in hexadecimal: the result of an answer that was given on the page."""
    PICTURE = b"p"
    """frame: its id. at: when it was captured. data: JPEG. Each `at` is in seconds of the monotonic clock,
    which both processes share: a message may have waited for a process that was stopped."""

    SETTINGS = b"s"
    """What the page shows of the file's settings: `SettingsFromPage.document`. Only where it has a token."""
    SETTINGS_ANSWER = b"t"
    """What became of a SETTINGS_REQUEST: its id, problem: why it is not done, "" where it is; see `tell` of
    `SettingsFromPage`."""
    MAP = b"m"
    """What is known of the ground, from above, as a picture is shown. data: PNG, b"" for none of late."""


ALIVE, WANTED, ANSWER = b"a", b"w", b"r"
"""From the web process: it lives; somebody watches, so that a picture should be drawn; an answer.

Of an answer, at: when it was handed over; data: the payload of a TUNNEL 45003."""
SETTINGS_REQUEST = b"s"
"""From the web process, too: of `PageRequest`."""
LONGEST_SAID = max(64 + MAX_PAYLOAD, 24 << 10)
"""Bytes of what the web process says."""
