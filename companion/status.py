"""What the companion is doing, as figures: for the status file, and for whoever asks from the ground."""

from __future__ import annotations

from collections import deque
from dataclasses import asdict
from statistics import median
from typing import Any

from companion.calls.machine import OperatorCalls
from companion.conversation import Conversation
from companion.link.link import Link
from companion.model import Model
from companion.settings_desk import SettingsDesk
from companion.trial import Trial
from companion.vision.client import Vision

_NEWEST = 25
"""Frames whose latency is told."""


class Status:
    """Looks at the parts and changes none.

    took: s that the newest frame took to judge. latencies: s of the newest, from capture until judged.
    """

    def __init__(
        self,
        link: Link,
        vision: Vision,
        calls: OperatorCalls,
        conversation: Conversation,
        desk: SettingsDesk,
        trial: Trial,
        model: Model,
    ) -> None:
        self._link = link
        self._vision = vision
        self._calls = calls
        self._conversation = conversation
        self._desk = desk
        self._trial = trial
        self._model = model
        self.took = 0.0
        self.latencies: deque[float] = deque(maxlen=_NEWEST)

    def figures(self, now: float) -> dict[str, Any]:
        """All of it as JSON values."""
        newest, camera = self._calls.sight.newest, self._vision.camera
        return {
            "state": self._calls.state(now).name.lower(),
            "reasons": sorted(reason.value for reason in self._calls.reasons(now)),
            "current_id": self._calls.current_id,
            "policy": self._calls.policy.name.lower(),
            "held_by": _held_by(self._calls),
            "switches": self._desk.policy.figures(),
            "shadow": self._desk.book.figures(self._calls.shadow),
            "words": self._conversation.words.format(),
            "set_by_ground": self._desk.overrides.figures(),
            "roi_uncertainty": newest.roi.uncertainty if newest and newest.roi else None,
            "similarity": newest.similarity if newest else None,
            "perceiver": {
                "model": self._model.id,
                "precision": self._model.precision,
                "why": self._model.why,
                "step_ms": round(1e3 * self.took, 1),
                "scene_age": round(newest.scene_age, 3) if newest else None,
            },
            "latency_ms": round(1e3 * median(self.latencies), 1) if self.latencies else None,
            "test_call": self._trial.status,
            "hold_refused": self._desk.policy.hold_refused,
            "vision": {"trouble": self._vision.trouble, "restarts": self._vision.restarted},
            "camera": {
                "state": camera.state.value,
                "reason": camera.reason,
                "read": camera.read,
                "dropped": camera.dropped,
            },
            "link": {"trouble": self._link.trouble, **asdict(self._link.counters)},
        }


def _held_by(calls: OperatorCalls) -> str | None:
    script = calls.holding.script_holds
    if script is not None:
        return f"script: {script.why}"
    return "companion" if calls.hold is not None and calls.hold.standing else None
