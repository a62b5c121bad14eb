"""Sets words and their weights, and sends the ground each weight that changes."""

from __future__ import annotations

from collections.abc import Iterable

from pymavlink.dialects.v20 import development as mavlink

from anytraverse.operations import ForgetWord, Operation, SetWord
from anytraverse.preferences import Preferences
from companion.daemon.answers.handler import AnswerHandler
from companion.daemon.settings.echo import BUSY, ParameterEcho
from companion.link.inbound import ParameterRequest, ResetRequest
from companion.link.link import Link
from companion.vision.client import VisionClient, VisionResult
from companion.vision.messages import Done
from companion.wire import notices
from companion.wire.answers import Acknowledgement, Answer
from companion.wire.ids import WARNING, Result
from companion.wire.parameters import NOT_IN_USE, Parameter

_ACCEPTED, _TRY_LATER = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_TEMPORARILY_REJECTED
_FAILED = mavlink.MAV_RESULT_FAILED


class WordSettings:
    """Has words set by the vision process, and echoes them once it has applied them.

    of: parameter name -> word, of the words that have a parameter of their own.
    """

    def __init__(
        self,
        parameters: Iterable[Parameter],
        link: Link,
        vision: VisionClient,
        answer_handler: AnswerHandler,
        echo: ParameterEcho,
    ) -> None:
        """parameters: as configured."""
        words = {one.name: (one.word, one.value) for one in parameters if one.word}
        self.of = {name: word for name, (word, _) in words.items()}
        self.configured = {name: weight for name, (_, weight) in words.items()}
        """Parameter name -> the configured weight, NOT_IN_USE without one."""
        self._sent: Preferences | None = None
        """What was sent last: sending waits until the words in use are in the journal."""
        self._link = link
        self._vision = vision
        self._answer_handler = answer_handler
        self._echo = echo

    def start(self, now: float) -> None:
        """Send the weights of all words."""
        for name, word in self.of.items():
            self._echo.send(name, self._vision.words.get(word, NOT_IN_USE), now)

    def set_weight(self, request: ParameterRequest, now: float) -> None:
        """Set the weight of one word, or forget it."""
        word = self.of[request.name]
        forget = request.value == NOT_IN_USE
        operation: Operation = ForgetWord(word) if forget else SetWord(word, request.value)
        if not self._answer_handler.set_words(request, (operation,)):
            self._echo.send(request.name, self._echo.values[request.name], now)
            self._refuse(now)

    def set_text(self, answer: Answer, now: float) -> None:
        """Set words that came as text."""
        if not self._answer_handler.set_words(answer, answer.changes):
            self._acknowledge_text(answer, Result.BUSY, now)
            self._refuse(now)

    def reset(self, request: ResetRequest, now: float) -> None:
        """Reset all words to the configured ones."""
        words = {self.of[name]: weight for name, weight in self.configured.items() if weight != NOT_IN_USE}
        others = [ForgetWord(word) for word in self._vision.words if word not in words]
        configured = [SetWord(word, weight) for word, weight in words.items()]
        if not self._answer_handler.set_words(request, (*others, *configured)):
            self._link.commands.acknowledge(request, _TRY_LATER, now)

    def answered(self, done: Done, result: VisionResult, stored: bool, now: float) -> None:
        """Echo or acknowledge words that the vision process has applied or refused.

        stored: whether they are in the journal.
        """
        request, applied = result.token, not done.error
        if isinstance(request, ParameterRequest):
            words, what = result.memory.preferences, request.name
            self._echo.send(request.name, words.get(self.of[request.name], NOT_IN_USE), now)
        elif isinstance(request, Answer):
            what = "words"
            self._acknowledge_text(request, Result.APPLIED if applied else Result.REFUSED, now)
        elif isinstance(request, ResetRequest):
            what = "Reset"
            self._link.commands.acknowledge(request, _ACCEPTED if applied else _FAILED, now)
        else:
            return
        if applied and not stored:
            self._link.texts.send(notices.not_remembered(what), WARNING, now)
        if done.outcome is not None and done.outcome.dropped:
            self._link.texts.send(notices.word_dropped(", ".join(done.outcome.dropped)), WARNING, now)

    def send_changes(self, now: float) -> None:
        """Send the ground the weights that changed without a request for them."""
        words = self._vision.words
        if words == self._sent:
            return
        self._sent = words
        self._link.text_parameters.set_words(words)
        for name, word in self.of.items():
            self._echo.send_change(name, words.get(word, NOT_IN_USE), now)

    def _acknowledge_text(self, answer: Answer, result: Result, now: float) -> None:
        self._link.answers.acknowledge(answer, Acknowledgement.without_figures(0, 0, result, ""), now)

    def _refuse(self, now: float) -> None:
        self._link.texts.send(notices.refused(BUSY), WARNING, now)
