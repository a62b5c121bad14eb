"""Sets the companion's parameters: settings, words and the policy."""

from __future__ import annotations

import logging
import math
import time
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.daemon.answers.handler import Handled
from companion.daemon.policy.service import PolicyService
from companion.daemon.policy.shadow_statistics import ShadowStatistics
from companion.daemon.settings.echo import ParameterEcho
from companion.daemon.settings.runtime import RuntimeSettings, judging_values
from companion.daemon.settings.words import WordSettings
from companion.link.inbound import ParameterRequest, ResetRequest
from companion.link.link import Link
from companion.wire import notices
from companion.wire.answers import Answer
from companion.wire.ids import WARNING, Policy
from companion.wire.parameters import BUDGET, NUMBER_RATE, POLICY, SHADOW_HOLDS, SUMMARY_RATE, TAP_WORD

log = logging.getLogger(__name__)
_RATES = {SUMMARY_RATE: "summary", NUMBER_RATE: "number"}
_LINK_PARAMETERS = (*_RATES, BUDGET)


class SettingsService:
    """Puts parameters in force. Values that differ from the configuration are stored in `overrides`."""

    def __init__(
        self,
        link: Link,
        policy: PolicyService,
        overrides: RuntimeSettings,
        words: WordSettings,
        statistics: ShadowStatistics,
        echo: ParameterEcho,
    ) -> None:
        """overrides: what the ground has set. statistics: the shadow policy's counts."""
        self._link = link
        self.policy = policy
        self.overrides = overrides
        self.words = words
        self.statistics = statistics
        self._echo = echo

    @property
    def settings(self) -> dict[str, float]:
        """The values in force, parameter name -> value, without the words' weights."""
        return {name: value for name, value in self._echo.values.items() if name not in self.words.of}

    def saved(self, now: float) -> dict[str, Any]:
        """Return what the journal stores: JSON values."""
        return {
            "policy": self.policy.state.saved(),
            "settings": self.overrides.saved(),
            "shadow": self.statistics.saved(now),
        }

    def start(self, now: float) -> None:
        """Put the link's settings in force, and send the values of all settings and words."""
        self._link.parameters.set_configured({**self.overrides.configured, **self.words.configured})
        if self._exceeds_link(self.overrides.values.get(BUDGET, self._link.most_budget)):
            log.warning("%s is as configured: the ground's value is more than the link carries", BUDGET)
            self.overrides.drop(BUDGET)
        values = self.overrides.configured | dict(self.overrides.values)
        for name, value in {**values, **judging_values(self.policy.judging)}.items():
            self._apply_to_link(name, value, now)
            self._echo.send(name, value, now)
        self._echo.send(POLICY, float(self.policy.state.in_force), now)
        self.words.start(now)

    def set(self, request: ParameterRequest | ResetRequest | Answer, now: float) -> Handled:
        """Handle a request to set a value, which is already checked to be in range, or words as text.

        Words are echoed once the vision process has applied them.
        """
        if isinstance(request, ResetRequest):
            self._reset(request, now)
        elif isinstance(request, Answer):
            self.words.set_text(request, now)
        elif request.name in self.words.of:
            self.words.set_weight(request, now)
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

    def send_changes(self, now: float) -> None:
        """Send the ground the shadow counts and the weights that changed without a request for them."""
        for name, value in self.statistics.values().items():
            self._echo.send_change(name, value, now)
        self.words.send_changes(now)

    def _set_value(self, request: ParameterRequest, now: float) -> None:
        name, value = request.name, request.value
        if name == BUDGET and self._exceeds_link(value):
            refusal = notices.value_refused(BUDGET, f"up to {self._link.most_budget:g}")
        else:
            refusal = "" if name in _LINK_PARAMETERS else self.policy.tune({name: value}, name)
        if refusal:
            log.warning("%s = %g requested by %d/%d is refused: %s", name, value, *request.sender, refusal)
            self._link.texts.send(refusal, WARNING, now)
            self._echo.send(name, self._echo.values[name], now)
            return
        log.info("%s = %g, set by %d/%d", name, value, *request.sender)
        self._apply_to_link(name, value, now)
        self._echo.send_after_write(name, value, f"{name} = {value:g}")
        self.overrides.set(name, value)

    def _reset(self, request: ResetRequest, now: float) -> None:
        """Reset the settings to their configured values, then the words.

        Where the words have to wait, the settings are done: a second request does what is left.
        """
        configured = {name: self.overrides.configured[name] for name in self.overrides.values}
        of_frames = {name: value for name, value in configured.items() if name not in _LINK_PARAMETERS}
        refusal = self.policy.tune(of_frames, "Reset")
        if refusal:
            self._link.texts.send(refusal, WARNING, now)
            self._link.commands.acknowledge(request, mavlink.MAV_RESULT_DENIED, now)
            return
        log.warning("settings and words are reset as configured, requested by %d/%d", *request.sender)
        for name, value in configured.items():
            self._apply_to_link(name, value, now)
            self._echo.send_after_write(name, value, "")  # the words' reply tells of all
        self.overrides.drop(*configured)
        self.words.reset(request, now)

    def _reset_shadow_counts(self, request: ParameterRequest, now: float) -> None:
        if request.value == 0:
            log.warning("shadow counts are reset, requested by %d/%d", *request.sender)
            self.statistics.reset(time.time())
        else:
            self._link.texts.send(notices.value_refused(SHADOW_HOLDS, "0: to count anew"), WARNING, now)
        holds = self.statistics.shadow.count
        self._echo.send_after_write(SHADOW_HOLDS, float(holds), f"{SHADOW_HOLDS} = {holds:g}")

    def _set_tap_word(self, index: float, now: float) -> None:
        entry = self._link.parameters.at(int(index))
        if index < 0 or (entry is not None and entry.word is not None):
            self._echo.send(TAP_WORD, index, now)
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
