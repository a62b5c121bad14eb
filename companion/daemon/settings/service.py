"""Sets the companion's parameters, and sends the ground each value that changes."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Mapping, Sequence
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from anytraverse.errors import SettingsError
from anytraverse.operations import ForgetWord, Operation, SetWord
from anytraverse.preferences import Preferences
from companion.calls.machine import OperatorCalls
from companion.daemon.answers.handler import AnswerHandler, Handled
from companion.daemon.policy.service import AfterWrite, PolicyService
from companion.daemon.policy.shadow_statistics import ShadowStatistics
from companion.daemon.settings.runtime import RuntimeSettings, judging_values, tuned
from companion.link.inbound import ParameterRequest, ResetRequest
from companion.link.link import Link
from companion.vision.client import VisionClient, VisionResult
from companion.vision.messages import Done
from companion.wire import notices
from companion.wire.answers import Acknowledgement, Answer
from companion.wire.ids import WARNING, Policy, Result
from companion.wire.parameters import (
    ANSWER,
    BUDGET,
    NOT_IN_USE,
    NUMBER_RATE,
    POLICY,
    SHADOW_HOLDS,
    SUMMARY_RATE,
    TAP_WORD,
    Parameter,
    ParameterError,
)

log = logging.getLogger(__name__)
_RATES = {SUMMARY_RATE: "summary", NUMBER_RATE: "number"}
_BUSY = "vision is busy, set it again"
_LINK_PARAMETERS = (*_RATES, BUDGET)
_NOT_IN_OVERRIDES = frozenset({POLICY, ANSWER, SHADOW_HOLDS, TAP_WORD})
"""Settings that may be set and are stored elsewhere, or not at all."""
_ACCEPTED, _TRY_LATER = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_TEMPORARILY_REJECTED
_DENIED, _FAILED = mavlink.MAV_RESULT_DENIED, mavlink.MAV_RESULT_FAILED


class SettingsService:
    """Puts parameters in force. Values that differ from the configuration are stored in `overrides`."""

    def __init__(
        self,
        parameters: Sequence[Parameter],
        link: Link,
        vision: VisionClient,
        calls: OperatorCalls,
        answer_handler: AnswerHandler,
        policy: PolicyService,
        overrides: RuntimeSettings,
        statistics: ShadowStatistics,
        after_write: AfterWrite,
    ) -> None:
        """parameters: as configured. overrides: what the ground has set. statistics: shadow policy's counts.

        after_write: registers what must not be sent before this turn's changes are in the journal.
        Raises ParameterError where a parameter may be set, but has no configured value to be stored against.
        """
        settable = {one.name for one in parameters if not (one.word or one.read_only)} - _NOT_IN_OVERRIDES
        if missing := settable - overrides.configured.keys():
            raise ParameterError(f"{', '.join(sorted(missing))} cannot be stored: add to storable_defaults")
        self._words = {parameter.name: parameter.word for parameter in parameters if parameter.word}
        self._configured = {one.word: one.value for one in parameters if one.word and one.value != NOT_IN_USE}
        self._sent = {parameter.name: parameter.value for parameter in parameters}
        self._sent_words: Preferences | None = None
        """What was sent last: sending waits until the words in use are in the journal."""
        self._link = link
        self._vision = vision
        self._calls = calls
        self._answer_handler = answer_handler
        self.overrides = overrides
        self.policy = policy
        self.statistics = statistics
        self._after_write = after_write

    @property
    def vocabulary(self) -> list[str]:
        """The words that have a parameter of their own."""
        return list(self._words.values())

    @property
    def settings(self) -> dict[str, float]:
        """The values in force, parameter name -> value, without the words' weights."""
        return {name: value for name, value in self._sent.items() if name not in self._words}

    def saved(self, now: float) -> dict[str, Any]:
        """Return what the journal stores: JSON values."""
        return {
            "policy": self.policy.state.saved(),
            "settings": self.overrides.saved(),
            "shadow": self.statistics.saved(self._calls.shadow, now),
        }

    def start(self, now: float) -> None:
        """Put the settings in force, and send the values of all settings and words.

        Vision judges no frame before this.
        """
        self._vision.tune(self._calls.numbers.judging)
        weights = {name: self._configured.get(word, NOT_IN_USE) for name, word in self._words.items()}
        self._link.parameters.set_configured({**self.overrides.configured, **weights})
        if self._exceeds_link(self.overrides.values.get(BUDGET, self._link.most_budget)):
            log.warning("%s is as configured: the ground's value is more than the link carries", BUDGET)
            self.overrides.drop(BUDGET)
        values = self.overrides.configured | dict(self.overrides.values)
        for name, value in {**values, **judging_values(self._calls.numbers.judging)}.items():
            self._apply_to_link(name, value, now)
            self._echo(name, value, now)
        self._echo(POLICY, float(self._calls.policy), now)
        for name, word in self._words.items():
            self._echo(name, self._vision.words.get(word, NOT_IN_USE), now)

    def set(self, request: ParameterRequest | ResetRequest | Answer, now: float) -> Handled:
        """Handle a request to set a value, which is already checked to be in range, or words as text.

        Words are echoed once the vision process has applied them.
        """
        if isinstance(request, ResetRequest):
            self._reset(request, now)
        elif isinstance(request, Answer):
            if not self._answer_handler.set_words(request, request.changes):
                self._acknowledge_text(request, Result.BUSY, now)
                self._refuse(_BUSY, now)
        elif request.name in self._words:
            self._set_weight(request, self._words[request.name], now)
        elif request.name == POLICY:
            _, decisions = self.policy.set(Policy(int(request.value)), request.sender, now)
            return Handled(decisions=decisions)
        elif request.name == SHADOW_HOLDS:
            self._reset_shadow_counts(request, now)
        elif request.name == TAP_WORD:
            self._set_tap_word(request.value, now)
        else:
            self._set_value(request, now)
        return Handled()

    def answered(self, done: Done, result: VisionResult, stored: bool, now: float) -> None:
        """Echo or acknowledge words that the vision process has applied or refused.

        stored: whether they are in the journal.
        """
        request, applied = result.token, not done.error
        if isinstance(request, ParameterRequest):
            words, what = result.memory.preferences, request.name
            self._echo(request.name, words.get(self._words[request.name], NOT_IN_USE), now)
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
        """Send the ground the shadow counts and the weights that changed without a request for them."""
        for name, value in self.statistics.values(self._calls.shadow).items():
            if value != self._sent[name]:
                self._echo(name, value, now)
        words = self._vision.words
        if words == self._sent_words:
            return
        self._sent_words = words
        self._link.text_parameters.set_words(words)
        for name, word in self._words.items():
            value = words.get(word, NOT_IN_USE)
            if value != self._sent[name]:
                self._echo(name, value, now)

    def _set_weight(self, request: ParameterRequest, word: str, now: float) -> None:
        forget = request.value == NOT_IN_USE
        operation: Operation = ForgetWord(word) if forget else SetWord(word, request.value)
        if not self._answer_handler.set_words(request, (operation,)):
            self._echo(request.name, self._sent[request.name], now)
            self._refuse(_BUSY, now)

    def _acknowledge_text(self, answer: Answer, result: Result, now: float) -> None:
        self._link.answers.acknowledge(answer, Acknowledgement.without_figures(0, 0, result, ""), now)

    def _set_value(self, request: ParameterRequest, now: float) -> None:
        name, value = request.name, request.value
        if name == BUDGET and self._exceeds_link(value):
            refusal = notices.value_refused(BUDGET, f"up to {self._link.most_budget:g}")
        else:
            refusal = "" if name in _LINK_PARAMETERS else self._tune({name: value}, name)
        if refusal:
            log.warning("%s = %g requested by %d/%d is refused: %s", name, value, *request.sender, refusal)
            self._link.texts.send(refusal, WARNING, now)
            self._echo(name, self._sent[name], now)
            return
        log.info("%s = %g, set by %d/%d", name, value, *request.sender)
        self._apply_to_link(name, value, now)
        self._echo_after_write(name, value)
        self.overrides.set(name, value)

    def _tune(self, values: Mapping[str, float], what: str) -> str:
        """Judge frames by these values from now on. Returns why that is refused, "" where it is not.

        Where hold is requested, values with which the vehicle could not stop in time are refused.
        """
        judging = self._calls.numbers.judging
        try:
            other = tuned(judging, values)
        except SettingsError as error:
            return notices.refused(str(error))
        refusal = self.policy.refuses_settings(other)
        if refusal is not None:
            log.warning("%s: %s", what, refusal.why)
            return notices.kept_for_hold(what, refusal.reason)
        if not self._vision.tune(other):
            return notices.refused(_BUSY)
        self._calls.retune(other)
        return ""

    def _reset(self, request: ResetRequest, now: float) -> None:
        """Reset the settings to their configured values, then the words.

        Where the words have to wait, the settings are done: a second request does what is left.
        """
        configured = {name: self.overrides.configured[name] for name in self.overrides.values}
        of_frames = {name: value for name, value in configured.items() if name not in _LINK_PARAMETERS}
        refusal = self._tune(of_frames, "Reset")
        if refusal:
            self._link.texts.send(refusal, WARNING, now)
            self._link.commands.acknowledge(request, _DENIED, now)
            return
        log.warning("settings and words are reset as configured, requested by %d/%d", *request.sender)
        for name, value in configured.items():
            self._apply_to_link(name, value, now)
            self._echo_after_write(name, value, told=False)  # the words' reply tells of all
        self.overrides.drop(*configured)
        others = [ForgetWord(word) for word in self._vision.words if word not in self._configured]
        words = [SetWord(word, weight) for word, weight in self._configured.items()]
        if not self._answer_handler.set_words(request, (*others, *words)):
            self._link.commands.acknowledge(request, _TRY_LATER, now)

    def _reset_shadow_counts(self, request: ParameterRequest, now: float) -> None:
        if request.value == 0:
            log.warning("shadow counts are reset, requested by %d/%d", *request.sender)
            self.statistics.reset(self._calls.shadow, time.time())
        else:
            self._link.texts.send(notices.value_refused(SHADOW_HOLDS, "0: to count anew"), WARNING, now)
        self._echo_after_write(SHADOW_HOLDS, float(self._calls.shadow.count))

    def _set_tap_word(self, index: float, now: float) -> None:
        entry = self._link.parameters.at(int(index))
        if index < 0 or (entry is not None and entry.word is not None):
            self._echo(TAP_WORD, index, now)
            return
        self._link.texts.send(notices.value_refused(TAP_WORD, "-1 or a word's index"), WARNING, now)
        self._link.parameters.echo_in_force(TAP_WORD, now)

    def _exceeds_link(self, budget: float) -> bool:
        # 0 means unlimited.
        return (budget or math.inf) > self._link.most_budget

    def _apply_to_link(self, name: str, value: float, now: float) -> None:
        if name in _RATES:
            self._link.set_rate(_RATES[name], value)
        elif name == BUDGET:
            self._link.set_budget(value, now)

    def _refuse(self, why: str, now: float) -> None:
        self._link.texts.send(notices.refused(why), WARNING, now)

    def _echo_after_write(self, name: str, value: float, *, told: bool = True) -> None:
        """Echo a value once it is in the journal. told: whether a text says so where it is not."""
        self._sent[name] = value

        def written(stored: bool, now: float) -> None:
            self._link.parameters.set_value(name, value, now)
            if told and not stored:
                self._link.texts.send(notices.not_remembered(f"{name} = {value:g}"), WARNING, now)

        self._after_write(written)

    def _echo(self, name: str, value: float, now: float) -> None:
        self._sent[name] = value
        self._link.parameters.set_value(name, value, now)
