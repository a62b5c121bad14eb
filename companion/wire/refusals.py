"""Lists why the companion refuses requests: the counters' names, and what the requester is sent."""

from __future__ import annotations

from typing import Literal, get_args

from companion.wire import notices, texts
from companion.wire.ids import Kind

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

_SILENCE = "nothing"
COUNTED: dict[Rejected, tuple[str, str]] = {
    "sender": ("a system id that is not in `allowed_senders` wants to change something", "DENIED and a text"),
    "rate": (
        "more than 20 requests a second, after 60 at once, from one of the first four senders or all others "
        "together; 5 after 20 of all who may not change anything",
        _SILENCE,
    ),
    "repeated": ("the same request on another connection within a second", "the first one's reply"),
    "target": ("all but reading parameters, to system 0 or component 0", _SILENCE),
    "payload": ("a torn or impossible TUNNEL or file transfer payload", _SILENCE),
    "version": ("a TUNNEL answer of another layout version", "a text"),
    "parts": ("more than 4 parts, or parts that contradict each other", "45004 REFUSED"),
    "command": ("31010 with parameters that say nothing", "DENIED and a text"),
    "unknown parameter": (
        "a name or index that is not listed",
        "PARAM_ERROR; PARAM_EXT_SET: FAILED; PARAM_EXT_REQUEST_READ: nothing",
    ),
    "range": ("a value out of range, or no value", "the old value and a text"),
    "read-only": ("setting what can only be read", "the old value and a text"),
    "file queue": ("a file request while 8 replies wait", _SILENCE),
    "unsigned": ("no signature, where a key is set", _SILENCE),
    "signature": ("a signature of another key", _SILENCE),
    "replay": ("a signed frame that is not newer", _SILENCE),
    "ahead": ("a signed frame of a year ahead", _SILENCE),
    "echo": ("a frame of our own that came back", _SILENCE),
    "clash": (
        "a frame under our ids that is not ours",
        "silence on that connection but for holds, a text on the others",
    ),
    "no autopilot for modes": ("a hold without a known autopilot; nobody asked", _SILENCE),
}
"""Counter -> what was refused, and what its sender gets."""

TEXTS: tuple[tuple[str, str], ...] = (
    (notices.sender_refused(7), "system id 7 may not change anything: `[link] allowed_senders`"),
    (notices.refused("p2 1-3, 4 weight, 5 policy, 6 other place"), "31010 with other parameters"),
    (texts.stale(7), "the answer's id is closed, or never was: read the newest call"),
    (texts.just_announced(Kind.CALL, 7), "an answer to id 0 less than 2 s after it was announced"),
    (texts.go_lapsed(Kind.CALL, 7), "vision took over 60 s for its words: the go is void"),
    (texts.go_taken_back(Kind.CALL, 7), "a stay, look again or word came before it counted: the newest wins"),
    (notices.value_refused("AT_SUM_HZ", "0 to 5"), "out of range, not a number, an integer's bits"),
    (notices.read_only("AT_SHD_HOURS"), "it cannot be set"),
    (notices.answer_refused(), "a value of `AT_ANSWER` that names no motion"),
    (notices.kept_for_hold("AT_ROI_T", notices.outruns(4.0, 1.3)), "it would not stop before what it sees"),
    (notices.hold_refused(0.7), "policy hold: its perceiver takes 0.7 s a frame"),
    (notices.hold_outruns(4.0, 1.3), "policy hold: it drives 4 m/s, 1.3 m/s would do"),
    (notices.hold_unchecked(), "policy hold: nobody can say whether it stops in time"),
    (notices.hold_infrared(), "policy hold: plants are pink, and the perceiver is not trained for that"),
    (notices.guide_lacks("[guide] radius"), "policy guide: a setting that it needs is missing"),
    (notices.switch_wins("RC7"), "a policy by radio while the remote control's switch says off"),
    (notices.other_version(), "a TUNNEL answer of another layout version"),
    (notices.refused('"7" has no weight'), "anything else: what follows says why"),
)
"""STATUSTEXTs of refusals, of severity WARNING (4), with example figures, and the reason of each."""


def counted_markdown() -> str:
    """Format the counters as a table for docs/protocol.md."""
    rows = ["| counted as | what was refused | its asker gets |", "|---|---|---|"]
    rows += [f"| `{name}` | {' | '.join(COUNTED[name])} |" for name in get_args(Rejected)]
    return "\n".join(rows) + "\n"


def texts_markdown() -> str:
    """Format the texts as a table for docs/protocol.md."""
    rows = ["| text | why |", "|---|---|"]
    rows += [f"| `{text}` | {why} |" for text, why in TEXTS]
    return "\n".join(rows) + "\n"


def markdown() -> str:
    """Format both tables for docs/protocol.md."""
    return f"{counted_markdown()}\n{texts_markdown()}"
