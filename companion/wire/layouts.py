"""Defines the fields of the TUNNEL payloads. Packing, unpacking and docs/protocol.md use these definitions.

Little-endian, without gaps. A text is a length byte, followed by that many bytes of UTF-8.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

TEXT = "text"
_TYPES = {"B": "u8", "H": "u16", "I": "u32", "h": "i16", "i": "i32"}
SHARE, COSINE, BOX, HASH = "share", "cosine", "box", "CRC"
"""Types of docs/protocol.md that say more than a number's size; what each means stands there."""


class Field(NamedTuple):
    """One field. code: of `struct`, or TEXT. values: unit, range, and the value for "unknown".

    means: the type as docs/protocol.md names it, "" where that is of the number's size: "u16", "u8[16]".
    """

    code: str
    name: str
    values: str = ""
    means: str = ""

    @property
    def size(self) -> int:
        """Size in bytes; for a text, of the length byte alone."""
        return 1 if self.code == TEXT else struct.calcsize(f"<{self.code}")

    @property
    def type(self) -> str:
        """The type as docs/protocol.md names it."""
        count, letter = self.code[:-1], self.code[-1]
        if self.means or self.code == TEXT:
            return self.means or TEXT
        return _TYPES[letter] + (f"[{count}]" if count else "")


class Layout:
    """The layout of a payload, or of one operation of an answer: fixed fields, then at most one text."""

    def __init__(self, title: str, *fields: Field, start: int = 0) -> None:
        """start: offset of the first field in bytes; what comes before is read separately."""
        self.title = title
        self.fields = fields
        self.start = start
        self.struct = struct.Struct("<" + "".join(one.code for one in fields if one.code != TEXT))


_VERSION = Field("B", "version")

SUMMARY = Layout(
    "Summary, 45001",
    _VERSION,
    Field("B", "state"),
    Field("B", "policy"),
    Field("B", "reasons", "of the newest frame"),
    Field("H", "sequence", "counts those sent on this connection"),
    Field("H", "current id", "of the open call or hold; 0: none"),
    Field("I", "frame id", "of the newest frame"),
    Field("H", "frame age", "ms, capture to sending"),
    Field("H", "latency", "ms, capture to judgement"),
    Field("H", "traversability", "of the region of interest", SHARE),
    Field("H", "uncertainty", means=SHARE),
    Field("H", "worst tile", means=SHARE),
    Field("h", "similarity", means=COSINE),
    Field("B", "field of view", "degrees, horizontal; 0: unknown"),
    Field("I", "words", means=HASH),
    Field("H", "dropped", "summaries that the budget dropped"),
    Field("16B", "sectors", "columns from the left, in 1/200 drivable; 255: unknown"),
)

CALL = Layout(
    "Call or hold, 45002",
    _VERSION,
    Field("B", "kind"),
    Field("B", "stage"),
    Field("B", "outcome", "0 until it is closed"),
    Field("B", "reasons", "its own, and those of now"),
    Field("B", "flags", "bit 0: the vehicle stands because of it; bit 1: a test"),
    Field("H", "id", "1 to 65535, one counter of calls and holds"),
    Field("I", "frame id", "of the frame that made it"),
    Field("H", "age", "s since it was announced"),
    Field("4H", "region of interest", means=BOX),
    Field("4H", "worst tile's box", "where to look", BOX),
    Field("H", "uncertainty", means=SHARE),
    Field("H", "worst tile", means=SHARE),
    Field("H", "drivable share", means=SHARE),
    Field("h", "similarity", means=COSINE),
    Field("i", "latitude", "1e-7 degrees; 2147483647: unknown"),
    Field("i", "longitude", "1e-7 degrees; 2147483647: unknown"),
    Field("H", "heading", "0.01 degrees from north; 65535: unknown"),
    Field("B", "words in use"),
    Field("I", "words", means=HASH),
    Field(TEXT, "picture", "path to fetch it by; empty: none"),
)

ANSWER = Layout(
    "Answer, 45003",
    _VERSION,
    Field("I", "transaction", "random, not 0"),
    Field("H", "target", "id of the call or hold; 0: the current one"),
    Field("B", "motion"),
    Field("B", "part", "from 0"),
    Field("B", "parts", "1 to 4"),
    Field("B", "operations", "how many follow in this part"),
)

_WEIGHT = Field("h", "weight", means=COSINE)
_WORD = Field(TEXT, "word")

SET = Layout("1 SET a word's weight", _WEIGHT, _WORD, start=1)
TAP = Layout(
    "2 TAP a thing in the call's frame",
    Field("I", "frame id", "the call's"),
    Field("4H", "box", means=BOX),
    _WEIGHT,
    _WORD,
    start=1,
)
FORGET_WORD = Layout("3 FORGET WORD: out of use", _WORD, start=1)
FORGET_CALL = Layout(
    "4 FORGET CALL: take what its answer taught out of memory",
    Field("H", "id", "of the answered call"),
    start=1,
)
NEW_EPISODE = Layout("5 NEW EPISODE: forget all answered places", start=1)
OTHER_PLACE = Layout(
    "6 OTHER PLACE: undo the newest match",
    Field("H", "id", "of the call whose place matched; 0: whichever did"),
    start=1,
)
PACK_INCIDENT = Layout(
    "7 PACK INCIDENT: pack an incident file",
    Field("H", "id", "of the call or hold; 0: the last minute"),
    start=1,
)
CANCEL_INCIDENT = Layout("8 CANCEL INCIDENT", Field("H", "id", "as in 7"), start=1)
RECORDING = Layout(
    "9 RECORDING: pack, or delete, one recording",
    Field("I", "number", "in its file's name"),
    Field("B", "wish", "0: pack it into a file, 1: pack it no more, 2: delete it"),
    start=1,
)
OPERATIONS = {
    1: SET,
    2: TAP,
    3: FORGET_WORD,
    4: FORGET_CALL,
    5: NEW_EPISODE,
    6: OTHER_PLACE,
    7: PACK_INCIDENT,
    8: CANCEL_INCIDENT,
    9: RECORDING,
}

ACKNOWLEDGEMENT = Layout(
    "Acknowledgement, 45004",
    _VERSION,
    Field("I", "transaction", "the answer's"),
    Field("H", "target", "the id that it was applied to; 0: none"),
    Field("B", "result"),
    Field("B", "stage", "where that call or hold stands now"),
    Field("B", "outcome", "how this closed it"),
    Field("H", "uncertainty", "of the call's frame judged again", SHARE),
    Field("H", "worst tile", "the same", SHARE),
    Field("B", "reasons", "of the newest frame judged again"),
    Field("I", "words", means=HASH),
    Field(TEXT, "text", "for a person, at most 90 bytes"),
)

FILE_TRANSFER = Layout(
    "FILE_TRANSFER_PROTOCOL",
    Field("H", "sequence", "the request's; the reply has one more"),
    Field("B", "session", "chosen by the client, the reply has the same"),
    Field("B", "opcode", "of a request as below; of a reply 128 ACK or 129 NAK"),
    Field("B", "size", "bytes of data, 0 to 239; in a read, how many are asked for"),
    Field("B", "request", "in a reply, the opcode that it answers"),
    Field("B", "burst complete", "1 in a burst's last frame"),
    Field("B", "padding", "0"),
    Field("I", "offset", "bytes into the file, or entries into a list"),
)
"""As specified at mavlink.io, service "FTP". 239 bytes of data follow; a path in them has no length byte."""
