"""Defines the fields of the TUNNEL payloads. Packing, unpacking and docs/protocol.md use these definitions.

Little-endian, without gaps. A text is a length byte, followed by that many bytes of UTF-8.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

TEXT = "text"
_TYPES = {"B": "u8", "H": "u16", "I": "u32", "h": "i16", "i": "i32"}
_ID = "0: none"
_FIGURE = ("0 to 10000 in 1e-4", "65535")
_BOX = ("left, top, right, bottom, each 0 to 10000 in 1e-4 of the frame", "all 65535")
_SIMILARITY = ("-10000 to 10000 in 1e-4", "-32768")
_HASH = "CRC-32 of the words in use, see Payloads"


class Field(NamedTuple):
    """One field. code: of `struct`, or TEXT. values: unit, scale, range. unknown: the value for "unknown"."""

    code: str
    name: str
    values: str
    unknown: str = ""

    @property
    def size(self) -> int:
        """Size in bytes; for a text, of the length byte alone."""
        return 1 if self.code == TEXT else struct.calcsize(f"<{self.code}")

    @property
    def type(self) -> str:
        """The type as docs/protocol.md names it, such as "u16" or "u8[16]"."""
        count, letter = self.code[:-1], self.code[-1]
        return TEXT if self.code == TEXT else _TYPES[letter] + (f"[{count}]" if count else "")


class Layout:
    """The layout of a payload, or of one operation of an answer: fixed fields, then at most one text."""

    def __init__(self, title: str, *fields: Field, start: int = 0) -> None:
        """start: offset of the first field in bytes; what comes before is read separately."""
        self.title = title
        self.fields = fields
        self._start = start
        self.struct = struct.Struct("<" + "".join(one.code for one in fields if one.code != TEXT))

    def markdown(self) -> str:
        """Format the layout as a table for docs/protocol.md."""
        rows = ["| offset | bytes | type | field | values | unknown |", "|---|---|---|---|---|---|"]
        offset = self._start
        for field in self.fields:
            size = "1 + n" if field.code == TEXT else str(field.size)
            cells = (str(offset), size, field.type, field.name, field.values, field.unknown)
            rows.append(f"| {' | '.join(cells)} |")
            offset += field.size
        return "\n".join(rows) + "\n"


_VERSION = Field("B", "version", "1; refuse others")

SUMMARY = Layout(
    "Summary, 45001",
    _VERSION,
    Field("B", "state", "number"),
    Field("B", "policy", "number"),
    Field("B", "reasons", "bits, of the newest frame"),
    Field("H", "sequence", "rises by one with each on this connection, then 0 again"),
    Field("H", "current id", f"of the open call or hold, {_ID}"),
    Field("I", "frame id", "of the newest frame"),
    Field("H", "frame age", "ms, capture to sending; 65535: that or more"),
    Field("H", "latency", "ms, capture to judgement; 65535: that or more"),
    Field("H", "traversability", *_FIGURE),
    Field("H", "uncertainty", *_FIGURE),
    Field("H", "worst tile", *_FIGURE),
    Field("h", "similarity", *_SIMILARITY),
    Field("B", "field of view", "degrees, horizontal", "0"),
    Field("I", "words", _HASH),
    Field("H", "dropped", "summaries that the budget kept off this connection; 65535: that or more"),
    Field(
        "16B", "sectors", "16 image columns of equal width from the left, 0 to 200 in 1/200 drivable", "255"
    ),
)

CALL = Layout(
    "Call or hold, 45002",
    _VERSION,
    Field("B", "kind", "number"),
    Field("B", "stage", "number"),
    Field("B", "outcome", "number; 0 until it is closed"),
    Field("B", "reasons", "bits: those of now, and until it is answered its own; of a closed call its own"),
    Field("B", "flags", "bit 0: the vehicle stands because of it; bit 1: a test; ignore the others"),
    Field("H", "id", "1 to 65535, then 1 again: one counter of calls and holds"),
    Field("I", "frame id", "of the frame that made it"),
    Field("H", "age", "s since it was announced; 65535: that or more"),
    Field("4H", "region of interest", *_BOX),
    Field("4H", "worst tile's box", *_BOX),
    Field("H", "uncertainty", *_FIGURE),
    Field("H", "worst tile", *_FIGURE),
    Field("H", "drivable share", *_FIGURE),
    Field("h", "similarity", *_SIMILARITY),
    Field("i", "latitude", "1e-7 degrees", "2147483647"),
    Field("i", "longitude", "1e-7 degrees", "2147483647"),
    Field("H", "heading", "0 to 35999 in 0.01 degrees from north", "65535"),
    Field("B", "words in use", "how many"),
    Field("I", "words", _HASH),
    Field(TEXT, "picture", "path to fetch it by, n up to 60; left out when it is closed", "n = 0"),
)

ANSWER = Layout(
    "Answer, 45003",
    _VERSION,
    Field("I", "transaction", "1 to 4294967295, chosen at random"),
    Field("H", "target", "id of the call or hold; 0: the current one"),
    Field("B", "motion", "number"),
    Field("B", "part", "from 0"),
    Field("B", "parts", "1 to 4"),
    Field("B", "operations", "how many follow in this part"),
)

_WEIGHT = Field("h", "weight", "-10000 to 10000 in 1e-4")
_WORD = Field(TEXT, "word", "n 1 to 96")

SET = Layout("1 SET a word's weight", _WEIGHT, _WORD, start=1)
TAP = Layout(
    "2 TAP a thing in the call's frame",
    Field("I", "frame id", "the call's"),
    Field("4H", "box", "left, top, right, bottom, each 0 to 10000 in 1e-4; left < right, top < bottom"),
    _WEIGHT,
    _WORD,
    start=1,
)
FORGET_WORD = Layout("3 FORGET WORD: out of use", _WORD, start=1)
FORGET_CALL = Layout(
    "4 FORGET CALL: take what its answer taught out of the memory",
    Field("H", "id", "of the answered call"),
    start=1,
)
NEW_EPISODE = Layout("5 NEW EPISODE: forget all answered places", start=1)
OTHER_PLACE = Layout(
    "6 OTHER PLACE: the newest match was not the same place, and is undone",
    Field("H", "id", "of the call whose place matched, 0: whichever did"),
    start=1,
)
PACK_INCIDENT = Layout(
    "7 PACK INCIDENT: put what is known of a call into a file",
    Field("H", "id", "of the call or hold, 0: the last minute"),
    start=1,
)
CANCEL_INCIDENT = Layout("8 CANCEL INCIDENT: pack it no more", Field("H", "id", "as in 7"), start=1)
OPERATIONS = {
    1: SET,
    2: TAP,
    3: FORGET_WORD,
    4: FORGET_CALL,
    5: NEW_EPISODE,
    6: OTHER_PLACE,
    7: PACK_INCIDENT,
    8: CANCEL_INCIDENT,
}

ACKNOWLEDGEMENT = Layout(
    "Acknowledgement, 45004",
    _VERSION,
    Field("I", "transaction", "the answer's"),
    Field("H", "target", f"the id that it was applied to, {_ID}"),
    Field("B", "result", "number"),
    Field("B", "stage", "number: where that call or hold stands now"),
    Field("B", "outcome", "number: how it was closed by this"),
    Field("H", "uncertainty", "of the call's frame judged again, " + _FIGURE[0], _FIGURE[1]),
    Field("H", "worst tile", "the same", _FIGURE[1]),
    Field("B", "reasons", "bits, of the newest frame judged again"),
    Field("I", "words", _HASH),
    Field(TEXT, "text", "for a person, n up to 90"),
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


def markdown() -> str:
    """Format all layouts as tables under their titles."""
    layouts = (SUMMARY, CALL, ANSWER, *OPERATIONS.values(), ACKNOWLEDGEMENT, FILE_TRANSFER)
    return "\n".join(f"{one.title}\n\n{one.markdown()}" for one in layouts)
