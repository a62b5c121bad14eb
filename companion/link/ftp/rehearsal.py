"""Somebody at the ground who asks for files request by request, in virtual time."""

from __future__ import annotations

from companion.link import encode
from companion.link.heard import Sender
from companion.link.rehearsal import Rehearsal
from companion.wire.ftp import FtpPayload, Opcode
from companion.wire.ids import COMPONENT_ID


class FileClient:
    """Believes nothing and repeats nothing by itself: what is sent and what comes is the caller's matter."""

    def __init__(self, stage: Rehearsal, sender: Sender = (255, 190)) -> None:
        self.stage = stage
        self.sender = sender
        self.sequence = 0
        self._seen = len(stage.sent("FILE_TRANSFER_PROTOCOL"))

    def request(
        self, opcode: int, data: bytes = b"", *, session: int = 0, offset: int = 0, size: int = 0
    ) -> FtpPayload:
        """The next request. size: bytes asked for, where no data is sent."""
        self.sequence += 1
        return FtpPayload(self.sequence, session, opcode, size or len(data), offset=offset, data=data)

    def send(self, request: FtpPayload, *, target: Sender = (1, COMPONENT_ID)) -> None:
        """It arrives at the link."""
        self.stage.send(encode.file_transfer(request.pack(), target), self.sender)

    def replies(self, seconds: float = 0.3) -> list[FtpPayload]:
        """Let time pass; what came since the last call."""
        self.stage.run(seconds)
        messages = self.stage.sent("FILE_TRANSFER_PROTOCOL")
        new, self._seen = messages[self._seen :], len(messages)
        ours = [one for one in new if (one.target_system, one.target_component) == self.sender]
        return [FtpPayload.unpack(bytes(one.payload)) for one in ours]

    def ask(self, request: FtpPayload) -> FtpPayload:
        """The first reply to it. Raises IndexError when none comes."""
        self.replies(0.0)
        self.send(request)
        return self.replies()[0]

    def open(self, path: str, *, session: int = 0) -> FtpPayload:
        """The reply to OPEN_FILE_RO."""
        return self.ask(self.request(Opcode.OPEN_FILE_RO, path.encode(), session=session))

    def read(self, *, session: int = 0, offset: int = 0, size: int = 80) -> FtpPayload:
        """The reply to READ_FILE."""
        return self.ask(self.request(Opcode.READ_FILE, session=session, offset=offset, size=size))
