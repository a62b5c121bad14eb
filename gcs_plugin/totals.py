"""What a session came to, counted from its events."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from statistics import median
from typing import Any

from companion.wire.ids import Result
from gcs_plugin import events as ev
from gcs_plugin.pending import Status
from gcs_plugin.records import plain
from gcs_plugin.rovers import Rover


class Totals:
    """Take in every event; `record` gives the figures."""

    def __init__(self) -> None:
        self._calls = 0
        self._by_reason: Counter[str] = Counter()
        self._by_outcome: Counter[str] = Counter()
        self._sent = 0
        self._acknowledged = 0

    def add(self, event: ev.Event) -> None:
        """Count it."""
        match event:
            case ev.CallOpened():
                self._calls += 1
                self._by_reason.update(plain(event.call.reasons))
            case ev.CallClosed():
                self._by_outcome[plain(event.call.outcome)] += 1
            case ev.AnswerMoved() if event.status is Status.SENT:
                self._sent += 1
            case ev.Acknowledged() if event.acknowledgement.result is not Result.BUSY:
                self._acknowledged += 1
            case _:
                pass

    def record(self, rovers: Mapping[int, Rover], seconds: float) -> dict[str, Any]:
        """As an object. latency_ms: capture to sending, as the rovers measured it."""
        counters = [rover.counters for rover in rovers.values()]
        latencies = [latency for counter in counters for latency in counter.latencies_ms]
        return {
            "event": "end",
            "seconds": round(seconds, 3),
            "summaries_received": sum(counter.summaries for counter in counters),
            "summaries_lost": sum(counter.summaries_lost for counter in counters),
            "calls": self._calls,
            "calls_by_reason": dict(self._by_reason),
            "answers_sent": self._sent,
            "answers_acknowledged": self._acknowledged,
            "closed_by_outcome": dict(self._by_outcome),
            "bytes_from_companion": sum(counter.bytes for counter in counters),
            "not_understood": sum(counter.rubbish for counter in counters),
            "latency_ms": {
                "p50": median(latencies) if latencies else None,
                "max": max((counter.latency_max_ms for counter in counters if latencies), default=None),
            },
        }
