"""AT_ANSWER: an answer without words from any parameter editor."""

from __future__ import annotations

from dataclasses import dataclass

from companion.link.desk import REPEAT_WITHIN
from companion.link.guard import Guard
from companion.link.heard import AnswerRequest, ParameterRequest
from companion.link.parameter_server import ParameterServer
from companion.link.remembered import Remembered
from companion.link.speaker import Speaker
from companion.wire import notices
from companion.wire.answers import Acknowledgement
from companion.wire.ids import Motion, Result
from companion.wire.parameters import ANSWER

_TAKEN = (Result.APPLIED, Result.APPLIED_NOT_REMEMBERED, Result.NOT_COVERED)


@dataclass
class _Case:
    """A wish that was handed on at `at`, or decided then; taken: None while it is not."""

    at: float
    taken: bool | None = None


class AnswerParameter:
    """The echo carries what was taken, 0 what was not; later reads give 0.

    A parameter cannot say that it is a repetition, so the same go or look again within 5 s is one, whether it
    names the id or not. "Stay" is handed on each time: it may have come after a go. What named no id and was
    stale is a repetition too: ground stations set a refused parameter again by themselves, and would answer a
    call that nobody has read.
    """

    def __init__(self, speaker: Speaker, guard: Guard, parameters: ParameterServer) -> None:
        self._speaker = speaker
        self._guard = guard
        self._parameters = parameters
        self._cases: Remembered[_Case] = Remembered()

    def hear(self, request: ParameterRequest, now: float) -> AnswerRequest | None:
        """A value in range: id x 10 + motion. 0 says nothing."""
        sender, value = request.sender, request.value
        target, code = divmod(int(value), 10)
        if not 1 <= code <= max(Motion):
            if value:
                self._guard.rejected["range"] += 1
                self._speaker.refuse(notices.answer_refused(), now)
            self._parameters.echo(ANSWER, 0.0, sender, now)
            return None
        key = (sender, target, Motion(code))
        case = self._cases.get(key)
        if case is not None and code != Motion.STAY and self._repeats(case, now):
            if case.taken is not None:
                self._parameters.echo(ANSWER, value if case.taken else 0.0, sender, now)
            return None
        self._cases.put(key, _Case(now))
        return AnswerRequest(sender, None, target, Motion(code), (), value)

    def acknowledge(self, request: AnswerRequest, ack: Acknowledgement, now: float) -> None:
        """What became of it, as echo and as text. What was not taken may be asked again at once."""
        taken = ack.result in _TAKEN
        value = request.value if taken and request.value is not None else 0.0
        self._speaker.answer(ack.text, now, taken=taken)
        self._parameters.echo(ANSWER, value, request.sender, now)
        for target in (request.target, ack.target):
            key = (request.sender, target, request.motion)
            self._cases.pop(key)
            if taken or (ack.result is Result.STALE and request.target == 0):
                self._cases.put(key, _Case(now, taken))

    def _repeats(self, case: _Case, now: float) -> bool:
        return now - case.at <= (self._guard.undecided_for if case.taken is None else REPEAT_WITHIN)
