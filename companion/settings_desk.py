"""The parameters of component 191: what each sets, and telling the ground when one changes by itself."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from dataclasses import replace

from anytraverse.errors import SettingsError
from anytraverse.judging import Thresholds
from anytraverse.preferences import Preferences
from companion.calls.machine import OperatorCalls
from companion.calls.policies import Policies
from companion.conversation import Conversation, Heard
from companion.eyes import Eyes
from companion.link.heard import ParameterRequest
from companion.link.link import Link
from companion.policy_desk import PolicyDesk
from companion.refusal import Refuses
from companion.shadow_book import ShadowBook
from companion.wire import notices
from companion.wire.ids import Policy
from companion.wire.parameters import (
    NOT_IN_USE,
    POLICY,
    SHADOW_HOLDS,
    THR_ROI,
    THR_SCENE,
    THR_TILE,
    THR_TRAV,
    Parameter,
)

log = logging.getLogger(__name__)
_THRESHOLDS = {THR_ROI: "roi", THR_SCENE: "scene", THR_TILE: "tile", THR_TRAV: "trav"}
_WARNING = 4


def setting_values(thresholds: Thresholds, policy: Policy) -> dict[str, float]:
    """Parameter name -> value of everything that is not a word."""
    values = {name: getattr(thresholds, field) for name, field in _THRESHOLDS.items()}
    return {name: NOT_IN_USE if value is None else value for name, value in values.items()} | {
        POLICY: float(policy)
    }


def _changed(thresholds: Thresholds, request: ParameterRequest) -> Thresholds:
    if request.name == THR_TILE:
        return replace(thresholds, tile=None if request.value == NOT_IN_USE else request.value)
    return replace(thresholds, **{_THRESHOLDS[request.name]: request.value})


class SettingsDesk:
    """Sets in force what a parameter asks for. Until the next restart: the config file is the owner's."""

    def __init__(
        self,
        parameters: Sequence[Parameter],
        link: Link,
        eyes: Eyes,
        calls: OperatorCalls,
        conversation: Conversation,
        refuses: Refuses,
        *,
        wants_hold: bool = False,
        policies: Policies | None = None,
        book: ShadowBook | None = None,
    ) -> None:
        """refuses: judges whether the vehicle may be held. wants_hold: the config asks for it.

        policies: what is in force, by default the state machine's. book: shadow policy's counts.
        """
        self._words = {parameter.name: parameter.word for parameter in parameters if parameter.word}
        self._told = {parameter.name: parameter.value for parameter in parameters}
        self._link = link
        self._eyes = eyes
        self._calls = calls
        self._conversation = conversation
        self.policy = PolicyDesk(
            link,
            calls,
            policies or Policies(calls.policy),
            refuses=refuses,
            wants_hold=wants_hold,
        )
        self.book = book or ShadowBook()

    def set(self, request: ParameterRequest, now: float) -> Heard:
        """A value, already in range. A word's weight is echoed once the eyes have applied it."""
        word = self._words.get(request.name)
        if word is not None:
            if not self._conversation.set_weight(request, word):
                self._echo(request.name, self._told[request.name], now)
                self._link.say(notices.refused("the eyes are busy, set it again"), _WARNING, now)
            return Heard()
        if request.name == POLICY:
            _, decisions = self.policy.set(Policy(int(request.value)), request.sender, now)
            return Heard(decisions=decisions)
        if request.name == SHADOW_HOLDS:
            self._count_anew(request, now)
        else:
            self._set_threshold(request, now)
        return Heard()

    def _count_anew(self, request: ParameterRequest, now: float) -> None:
        if request.value == 0:
            log.warning("shadow counts begin anew, by %d/%d", *request.sender)
            self.book.begin_anew(self._calls.shadow, time.time())
        else:
            self._link.say(notices.value_refused(SHADOW_HOLDS, "0: to count anew"), _WARNING, now)
        self._echo(SHADOW_HOLDS, float(self._calls.shadow.count), now)

    def _set_threshold(self, request: ParameterRequest, now: float) -> None:
        judging = self._calls.numbers.judging
        value, refusal = self._told[request.name], ""
        try:
            judging = replace(judging, thresholds=_changed(judging.thresholds, request))
        except SettingsError as error:
            refusal = str(error)
        else:
            if self._eyes.retune(judging):
                self._calls.retune(judging)
                value = request.value
            else:
                refusal = "the eyes are busy, set it again"
        self._echo(request.name, value, now)
        if refusal:
            self._link.say(notices.refused(refusal), _WARNING, now)

    def answered(self, request: ParameterRequest, words: Preferences, now: float) -> None:
        """The eyes have applied a weight, or refused it: the echo says which."""
        self._echo(request.name, words.get(self._words[request.name], NOT_IN_USE), now)

    def tell_changes(self, words: Preferences, now: float) -> None:
        """Tell the ground every weight that changed by itself, and what was counted."""
        for name, value in self.book.values(self._calls.shadow).items():
            if value != self._told[name]:
                self._echo(name, value, now)
        for name, word in self._words.items():
            value = words.get(word, NOT_IN_USE)
            if value != self._told[name]:
                self._echo(name, value, now)

    def _echo(self, name: str, value: float, now: float) -> None:
        self._told[name] = value
        self._link.set_parameter(name, value, now)
