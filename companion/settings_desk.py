"""The parameters of component 191: what each sets, and telling the ground when one changes by itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from anytraverse.errors import SettingsError
from anytraverse.judging import Thresholds
from anytraverse.preferences import Preferences
from companion.calls.machine import OperatorCalls
from companion.conversation import Conversation, Heard
from companion.eyes import Eyes
from companion.link.heard import ParameterRequest
from companion.link.link import Link
from companion.refusal import Refusal
from companion.wire import texts
from companion.wire.ids import Policy
from companion.wire.parameters import (
    NOT_IN_USE,
    POLICY,
    THR_ROI,
    THR_SCENE,
    THR_TILE,
    THR_TRAV,
    Parameter,
)

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
        refusal: Refusal | None,
        *,
        wants_hold: bool = False,
    ) -> None:
        """refusal: why the vehicle may not be held. wants_hold: the config asks for it."""
        self._words = {parameter.name: parameter.word for parameter in parameters if parameter.word}
        self._told = {parameter.name: parameter.value for parameter in parameters}
        self._link = link
        self._eyes = eyes
        self._calls = calls
        self._conversation = conversation
        self.hold_refused = refusal.short if refusal is not None else ""
        """Why the vehicle may not be held, "" where it may."""
        self.reminder = refusal.reminder if refusal is not None and wants_hold else ""
        """To be repeated: the owner believes in a hold that is refused. "" once a policy was set."""

    def set(self, request: ParameterRequest, now: float) -> Heard:
        """A value, already in range. A word's weight is echoed once the eyes have applied it."""
        word = self._words.get(request.name)
        if word is not None:
            if not self._conversation.set_weight(request, word):
                self._echo(request.name, self._told[request.name], now)
                self._link.say(texts.refused("the eyes are busy, set it again"), _WARNING, now)
            return Heard()
        if request.name == POLICY:
            return self._set_policy(Policy(int(request.value)), now)
        self._set_threshold(request, now)
        return Heard()

    def _set_policy(self, policy: Policy, now: float) -> Heard:
        if policy is Policy.HOLD and self.hold_refused:
            self._echo(POLICY, float(self._calls.policy), now)
            self._link.say(self.hold_refused, _WARNING, now)
            return Heard()
        self.reminder = ""
        decisions = self._calls.set_policy(policy, now)
        self._link.say(texts.policy(policy), _WARNING, now)
        self._echo(POLICY, float(policy), now)
        return Heard(decisions=decisions)

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
            self._link.say(texts.refused(refusal), _WARNING, now)

    def answered(self, request: ParameterRequest, words: Preferences, now: float) -> None:
        """The eyes have applied a weight, or refused it: the echo says which."""
        self._echo(request.name, words.get(self._words[request.name], NOT_IN_USE), now)

    def tell_changes(self, words: Preferences, now: float) -> None:
        """Tell the ground every weight that changed by an answer or a remembered scene."""
        for name, word in self._words.items():
            value = words.get(word, NOT_IN_USE)
            if value != self._told[name]:
                self._echo(name, value, now)

    def _echo(self, name: str, value: float, now: float) -> None:
        self._told[name] = value
        self._link.set_parameter(name, value, now)
