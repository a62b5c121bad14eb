"""What is asked of component 191, each handed to whoever answers it; component 0 may only be read."""

from __future__ import annotations

from typing import Any

from companion.link.answer_parameter import AnswerParameter
from companion.link.command_desk import CommandDesk
from companion.link.desk import AnswerDesk
from companion.link.ftp.server import FtpServer
from companion.link.guard import Guard
from companion.link.heard import Heard, Sender
from companion.link.parameter_server import ParameterServer
from companion.link.text_parameters import TextParameters
from companion.wire.ids import ANSWER_COMMAND, COMPONENT_ID
from companion.wire.parameters import ANSWER

FILES = "FILE_TRANSFER_PROTOCOL"
REQUESTS = frozenset(
    {
        "PARAM_REQUEST_LIST",
        "PARAM_REQUEST_READ",
        "PARAM_SET",
        "PARAM_EXT_REQUEST_LIST",
        "PARAM_EXT_REQUEST_READ",
        "PARAM_EXT_SET",
        "TUNNEL",
        "COMMAND_LONG",
        "COMMAND_INT",
        FILES,
    }
)


class Requests:
    """Takes messages of `REQUESTS` that are meant for us and were admitted."""

    def __init__(
        self,
        guard: Guard,
        parameters: ParameterServer,
        texts: TextParameters,
        answers: AnswerParameter,
        desk: AnswerDesk,
        commands: CommandDesk,
        files: FtpServer,
    ) -> None:
        self._guard = guard
        self._parameters = parameters
        self._texts = texts
        self._answers = answers
        self._desk = desk
        self._commands = commands
        self._files = files

    def hear(self, sender: Sender, message: Any, now: float) -> Heard | None:
        """Answer it, or return what the daemon must know."""
        kind = message.get_type()
        if kind == "PARAM_REQUEST_LIST":
            self._parameters.list_all(sender)
        elif kind == "PARAM_REQUEST_READ":
            self._parameters.read(sender, message, now)
        elif kind == "PARAM_EXT_REQUEST_LIST":
            self._texts.list_all(sender)
        elif kind == "PARAM_EXT_REQUEST_READ":
            self._texts.read(sender, message, now)
        elif message.target_component != COMPONENT_ID or message.target_system == 0:
            self._guard.rejected["target"] += 1
        elif kind == FILES:
            self._files.hear(sender, message, now)
        elif kind == "PARAM_SET":
            return self._set(sender, message, now)
        elif kind == "PARAM_EXT_SET":
            return self._texts.set(sender, message, now)
        elif kind == "TUNNEL":
            return self._hear_answer(sender, message, now)
        elif message.command == ANSWER_COMMAND:
            return self._desk.command(sender, message, now)
        else:
            return self._commands.hear(sender, message, now)
        return None

    def _set(self, sender: Sender, message: Any, now: float) -> Heard | None:
        request = self._parameters.set(sender, message, now)
        if request is not None and request.name == ANSWER:
            return self._answers.hear(request, now)
        return request

    def _hear_answer(self, sender: Sender, message: Any, now: float) -> Heard | None:
        if message.payload_length > len(message.payload):
            self._guard.rejected["payload"] += 1
            return None
        return self._desk.tunnel(sender, bytes(message.payload[: message.payload_length]), now)
