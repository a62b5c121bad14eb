"""Packs and unpacks the 251-byte payload of FILE_TRANSFER_PROTOCOL (110), see mavlink.io, service "FTP"."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum

from companion.wire.layouts import FILE_TRANSFER
from companion.wire.packing import PayloadError

PAYLOAD = 251
MAX_DATA = 239
SMALL_DATA = 80
"""Bytes of a file in one burst frame on a link with a byte budget: radios split and lose long frames."""

_HEAD = FILE_TRANSFER.struct


class Opcode(IntEnum):
    """What a request asks for, and the two replies."""

    NONE = 0
    TERMINATE_SESSION = 1
    RESET_SESSIONS = 2
    LIST_DIRECTORY = 3
    OPEN_FILE_RO = 4
    READ_FILE = 5
    CREATE_FILE = 6
    WRITE_FILE = 7
    REMOVE_FILE = 8
    CREATE_DIRECTORY = 9
    REMOVE_DIRECTORY = 10
    OPEN_FILE_WO = 11
    TRUNCATE_FILE = 12
    RENAME = 13
    CALC_FILE_CRC32 = 14
    BURST_READ_FILE = 15
    ACK = 128
    NAK = 129


WRITES = frozenset(range(Opcode.CREATE_FILE, Opcode.RENAME + 1))
"""Opcodes of the requests that would change a file."""


class FtpError(IntEnum):
    """The error code in a NAK."""

    FAIL = 1
    FAIL_ERRNO = 2
    INVALID_DATA_SIZE = 3
    INVALID_SESSION = 4
    NO_SESSIONS_AVAILABLE = 5
    END_OF_FILE = 6
    UNKNOWN_COMMAND = 7
    FILE_EXISTS = 8
    FILE_PROTECTED = 9
    FILE_NOT_FOUND = 10


@dataclass(frozen=True)
class FtpPayload:
    """A request or a reply.

    opcode: `Opcode`, or a number that this version does not know. request: in a reply, the opcode that it
    answers. size: bytes of `data`; in a read request, the bytes asked for. offset: bytes into the file, or
    entries into a list.
    """

    sequence: int
    session: int
    opcode: int
    size: int
    request: int = 0
    burst_complete: bool = False
    offset: int = 0
    data: bytes = b""

    def pack(self) -> bytes:
        """Pack into 251 bytes, padded with zeros. Raises PayloadError when a value does not fit its field."""
        if not len(self.data) <= self.size <= MAX_DATA:
            raise PayloadError(f"{len(self.data)} bytes of data, said to be {self.size}, at most {MAX_DATA}")
        try:
            head = _HEAD.pack(
                self.sequence,
                self.session,
                self.opcode,
                self.size,
                self.request,
                self.burst_complete,
                0,
                self.offset,
            )
        except struct.error as error:
            raise PayloadError(str(error)) from error
        return (head + self.data).ljust(PAYLOAD, b"\0")

    @classmethod
    def unpack(cls, payload: bytes) -> FtpPayload:
        """Unpack and check; zeros that MAVLink cut off are put back into `data`. Raises PayloadError."""
        if not _HEAD.size <= len(payload) <= PAYLOAD:
            raise PayloadError(f"file transfer payload of {len(payload)} bytes")
        sequence, session, opcode, size, request, complete, _padding, offset = _HEAD.unpack_from(payload)
        if size > MAX_DATA:
            raise PayloadError(f"size {size} is above {MAX_DATA}")
        data = payload[_HEAD.size : _HEAD.size + size].ljust(size, b"\0")
        return cls(sequence, session, opcode, size, request, bool(complete), offset, data)

    def path(self) -> str:
        """Decode the data as a path, up to its first NUL. Raises PayloadError."""
        try:
            return self.data.partition(b"\0")[0].decode()
        except UnicodeDecodeError as error:
            raise PayloadError("the path is not UTF-8") from error

    def ack(self, data: bytes = b"", *, offset: int | None = None) -> FtpPayload:
        """Make the ACK for this request: same session, next sequence number."""
        return self._reply(Opcode.ACK, data, self.offset if offset is None else offset)

    def nak(self, error: FtpError) -> FtpPayload:
        """Make the NAK for this request."""
        return self._reply(Opcode.NAK, bytes([error]), self.offset)

    def _reply(self, opcode: Opcode, data: bytes, offset: int) -> FtpPayload:
        sequence = (self.sequence + 1) & 0xFFFF
        return FtpPayload(sequence, self.session, opcode, len(data), self.opcode, offset=offset, data=data)
