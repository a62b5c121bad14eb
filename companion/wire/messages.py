"""Lists every message on the wire in one table. Rates, sizes, priorities, docs and tests use it."""

from __future__ import annotations

from typing import Literal, NamedTuple

Direction = Literal["to ground", "from ground", "to autopilot", "from autopilot"]
Bucket = Literal["unsolicited", "asked"]

UP: Direction = "to ground"
DOWN: Direction = "from ground"
OUT: Direction = "to autopilot"
IN: Direction = "from autopilot"
FREE: Bucket = "unsolicited"
ASKED: Bucket = "asked"


class Message(NamedTuple):
    """One row of the table.

    period: s, None for no fixed rate. bytes: of the longest frame, unsigned MAVLink 2. priority: 0 is sent
    first; None: the companion does not send it. bucket: the byte budget that it counts against, if any.
    of_camera: whether the camera sends it, a component of its own.
    """

    name: str
    mavlink: str
    purpose: str
    direction: Direction
    period: float | None
    bytes: int
    priority: int | None
    bucket: Bucket | None
    when_lost: str
    of_camera: bool = False


_Row = tuple[str, str, str, Direction, float | None, int, int | None, Bucket | None, str]

# name, MAVLink, what for, direction, period, bytes, priority, budget, when lost
# fmt: off
_ROWS: tuple[_Row, ...] = (
    ("heartbeat",   "HEARTBEAT",           "alive, state, id",  UP,   1.0,  21,  0,    FREE,  "next one"),
    ("call text",   "STATUSTEXT",          "call, for people",  UP,   None, 63,  1,    FREE,  "repeated"),
    ("call data",   "TUNNEL 45002",        "call, for programs", UP,   None, 145, 1,    FREE,  "repeated"),
    ("answer ack",  "TUNNEL 45004",        "its outcome",       UP,   None, 145, 2,    ASKED, "asked again"),
    ("command ack", "COMMAND_ACK",         "its outcome",       UP,   None, 22,  2,    ASKED, "asked again"),
    ("echo",        "PARAM_VALUE",         "set or asked for",  UP,   None, 37,  3,    ASKED, "asked again"),
    ("no parameter", "PARAM_ERROR",        "it is not listed",  UP,   None, 33,  3,    ASKED, "asked again"),
    ("text ack",    "PARAM_EXT_ACK",       "words set by text", UP,   None, 158, 2,    ASKED, "asked again"),
    ("text echo",   "PARAM_EXT_VALUE",     "words as text",     UP,   None, 161, 3,    ASKED, "asked again"),
    ("version",     "AUTOPILOT_VERSION",   "what we can do",    UP,   None, 90,  3,    ASKED, "asked again"),
    ("interval reply", "MESSAGE_INTERVAL", "asked for",         UP,   None, 18,  3,    ASKED, "asked again"),
    ("heartbeat asked", "HEARTBEAT",       "newest, once",      UP,   None, 21,  3,    ASKED, "asked again"),
    ("summary asked", "TUNNEL 45001",      "newest, once",      UP,   None, 64,  3,    ASKED, "asked again"),
    ("number asked", "NAMED_VALUE_FLOAT",  "newest, once",      UP,   None, 27,  3,    ASKED, "asked again"),
    ("changed value", "PARAM_VALUE",       "changed, unasked", UP,   None, 37,  3,    FREE,  "read again"),
    ("text",        "STATUSTEXT",          "notices, refusals", UP,   None, 63,  4,    FREE,  "lost"),
    ("summary",     "TUNNEL 45001",        "newest frame",      UP,   1.0,  64,  5,    FREE,  "next one"),
    ("number",      "NAMED_VALUE_FLOAT",   "figures to plot",   UP,   2.0,  27,  6,    FREE,  "next one"),
    ("computer",    "ONBOARD_COMPUTER_STATUS", "heat, load", UP,   30.0, 252, 10,   FREE,  "next one"),
    ("list",        "PARAM_VALUE",         "all parameters",    UP,   None, 37,  7,    ASKED, "asked again"),
    ("file reply",  "FILE_TRANSFER_PROTOCOL", "lists, ACK, NAK", UP,  None, 266, 8,    ASKED, "asked again"),
    ("file data",   "FILE_TRANSFER_PROTOCOL", "bursts",          UP,  None, 266, 9,    ASKED, "asked again"),
    ("text list",   "PARAM_EXT_VALUE",     "all of them",       UP,   None, 161, 7,    ASKED, "asked again"),
    ("answer",      "TUNNEL 45003",        "motion and words",  DOWN, None, 145, None, None,  "sent again"),
    ("command",     "COMMAND_LONG 31010",  "motion, weight",    DOWN, None, 45,  None, None,  "sent again"),
    ("set",         "PARAM_SET",           "weight, setting",   DOWN, None, 35,  None, None,  "sent again"),
    ("read",        "PARAM_REQUEST_*",     "one or all",        DOWN, None, 32,  None, None,  "asked again"),
    ("text set",    "PARAM_EXT_SET",       "words as text",     DOWN, None, 159, None, None,  "sent again"),
    ("text read",   "PARAM_EXT_REQUEST_*", "one or all",        DOWN, None, 32,  None, None,  "asked again"),
    ("request",     "COMMAND_LONG",        "version, rates",    DOWN, None, 45,  None, None,  "sent again"),
    ("file request", "FILE_TRANSFER_PROTOCOL", "list, read", DOWN, None, 266, None, None, "asked again"),
    ("hold",        "COMMAND_LONG 31014 or 176", "stand still", OUT,  None, 45,  0,    None,  "three tries"),
    ("resume",      "COMMAND_LONG 31014 or 176", "drive on",    OUT,  None, 45,  0,    None,  "three tries"),
    ("guide",       "COMMAND_LONG 31014",  "GUIDED, AUTO again", OUT,  None, 45,  0,    None,  "it is held"),
    ("target",      "SET_POSITION_TARGET_LOCAL_NED", "drive round it", OUT, 0.1, 65, 0,  None, "next one"),
    ("script",      "COMMAND_LONG 31014",  "is it there",       OUT,  5.0,  45,  7,    None,  "next one"),
    ("interval",    "COMMAND_LONG 511",    "asks for streams",  OUT,  10.0, 45,  7,    None,  "next one"),
    ("setpoint",    "SET_POSITION_TARGET_LOCAL_NED", "stand still (PX4)", OUT, 0.2, 65, 0, None, "next one"),
    ("sticks",      "MANUAL_CONTROL",      "centred: it lives (PX4)", OUT, 0.1, 23, 0, None, "next one"),
    ("set item",    "COMMAND_LONG 224",    "makes it current", OUT,  None, 45,  1,    None,  "up to six"),
    ("mission list", "MISSION_REQUEST_LIST", "how many items",  OUT,  None, 15,  7,    None,  "five tries"),
    ("mission request", "MISSION_REQUEST_INT", "one item",      OUT,  None, 17,  7,    None,  "five tries"),
    ("mission taken", "MISSION_ACK",       "all items came",    OUT,  None, 16,  7,    None,  "lost"),
    ("vehicle",     "HEARTBEAT",           "id, mode, armed",   IN,   1.0,  21,  None, None,  "next one"),
    ("position",    "GLOBAL_POSITION_INT", "place, speed",      IN,   0.5,  40,  None, None,  "old in 5 s"),
    ("attitude",    "ATTITUDE",            "how it stands",     IN,   0.25, 40,  None, None,  "old in 5 s"),
    ("throttle",    "VFR_HUD",             "whether it drives", IN,   0.5,  32,  None, None,  "old in 5 s"),
    ("time",        "SYSTEM_TIME",         "where ours is not set", IN, 5.0, 24, None, None, "next one"),
    ("rc",          "RC_CHANNELS",         "off switch",        IN,   0.2,  54,  None, None,  "old in 3 s"),
    ("rc health",   "SYS_STATUS",          "transmitter lost",  IN,   1.0,  55,  None, None,  "old in 5 s"),
    ("current mode", "CURRENT_MODE",        "PX4 mode, sooner",  IN,   0.2,  21,  None, None,  "heartbeat"),
    ("mission",     "MISSION_CURRENT",     "complete, item",    IN,   1.0,  30,  None, None,  "old in 5 s"),
    ("item reached", "MISSION_ITEM_REACHED", "the last item",   IN,   None, 14,  None, None,  "lost"),
    ("mission count", "MISSION_COUNT",     "how many items",    IN,   None, 17,  None, None,  "asked again"),
    ("mission item", "MISSION_ITEM_INT",   "one item",          IN,   None, 50,  None, None,  "asked again"),
    ("mission refused", "MISSION_ACK",     "why no items",      IN,   None, 16,  None, None,  "asked again"),
    ("item ack",    "COMMAND_ACK",         "current or not",    IN,   None, 22,  None, None,  "sent again"),
    ("script text", "STATUSTEXT",          "the script's hold", IN,   10.0, 63,  None, None,  "next one"),
    ("mode ack",    "COMMAND_ACK",         "mode taken or not", IN,   None, 22,  None, None,  "next one"),
)
_OF_CAMERA: tuple[_Row, ...] = (
    ("camera heartbeat", "HEARTBEAT",       "a camera is there",   UP, 1.0,  21,  6, FREE,  "next one"),
    ("camera ack",    "COMMAND_ACK",        "its outcome",         UP, None, 22,  2, ASKED, "asked again"),
    ("camera information", "CAMERA_INFORMATION", "what it can do", UP, None, 249, 3, ASKED, "asked again"),
    ("stream information", "VIDEO_STREAM_INFORMATION", "its video", UP, None, 227, 3, ASKED, "asked again"),
    ("stream status", "VIDEO_STREAM_STATUS", "the same, short",    UP, None, 32,  3, ASKED, "asked again"),
    ("camera settings", "CAMERA_SETTINGS",  "that it has none",    UP, None, 26,  3, ASKED, "asked again"),
    ("camera storage", "STORAGE_INFORMATION", "that it has none",  UP, None, 73,  3, ASKED, "asked again"),
    ("capture status", "CAMERA_CAPTURE_STATUS", "that it takes none", UP, None, 35, 3, ASKED, "asked again"),
    ("tracking status", "CAMERA_TRACKING_IMAGE_STATUS", "what was tapped", UP, 0.5, 44, 5, ASKED, "next one"),
    ("camera command", "COMMAND_LONG",      "a tap, or a request", DOWN, None, 45, None, None, "sent again"),
)
# fmt: on
TABLE = (*(Message(*row) for row in _ROWS), *(Message(*row, of_camera=True) for row in _OF_CAMERA))
MESSAGES = {message.name: message for message in TABLE}
TELEMETRY = frozenset(message.mavlink for message in TABLE if message.direction == IN)
"""Messages that the companion reads from the autopilot, by MAVLink name."""

SUMMARY_PERIOD_WHILE_CALLING = 5.0
"""s between summaries while a call or hold is open; the numbers then stop."""

DATA_FIRST_PERIOD = 0.6
DATA_PERIOD = 1.0
DATA_REPEATS = 6
DATA_SLOW_PERIOD = 10.0
CLOSED_REPEATS = 3
"""Call data is sent `DATA_REPEATS` times, every `DATA_FIRST_PERIOD` s, then every `DATA_SLOW_PERIOD` s.

One that has changed is sent after `DATA_PERIOD` s.

A closed one is sent `CLOSED_REPEATS` times.
"""

TEXT_PERIOD = 15.0
TEXT_ALERT_AFTER = 45.0
TEXT_SLOW_PERIOD = 60.0
"""Call text is sent at once, then every 15 s; after 45 s as an ALERT, then every 60 s."""

NUMBERS = ("AT_TRAV", "AT_UNC", "AT_SIM", "AT_CALL")
