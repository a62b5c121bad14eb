"""Counts from what field and operator saw whether the demo has shown all that it must."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from statistics import median
from typing import Any

from companion.sim.demo.onlooker import Shown
from companion.sim.repeats import AskedBefore


@dataclass
class DemoTally:
    """Take in the operator's events and the field's status; `figures` and `missing` are the verdict."""

    calls: dict[int, list[str]] = field(default_factory=dict)
    holds_announced: set[int] = field(default_factory=set)
    closed: dict[int, str] = field(default_factory=dict)
    acknowledged: int = 0
    taps: int = 0
    words: int = 0
    history_matches: int = 0
    blocked: int = 0
    kept_off: int = 0
    taken_over: int = 0
    """Holds that a human ended, where nothing was in the way."""
    slowed_down: int = 0
    """How often the computer became too busy for the pace."""
    driven_round: int = 0
    """Things that the companion drove past in GUIDED."""
    summaries: int = 0
    received: dict[int, float] = field(default_factory=dict)
    returned_without_call: bool = False
    things: set[str] = field(default_factory=set)
    """Things of the simulation that calls were about."""
    places: set[str] = field(default_factory=set)
    """Kinds of place that calls were about."""
    repeat_calls: int = 0
    """Calls about what was answered a moment ago, see `AskedBefore`."""
    asked_before: AskedBefore = field(default_factory=AskedBefore)
    state: str = ""
    """The daemon's, as the operator heard it last."""

    @property
    def calls_for_places(self) -> int:
        """Calls for which the place was a reason."""
        return sum("unknown_scene" in reasons for reasons in self.calls.values())

    def event(self, event: dict[str, Any], at: float) -> None:
        """One event of the operator's. at: monotonic seconds when it was read."""
        name = event.get("event")
        if name == "call" and event["kind"] == "call":
            self.calls[event["id"]] = event["reasons"]
        elif name == "call":
            self.holds_announced.add(event["id"])
        elif name == "closed" and event["id"] in self.calls:
            self.closed[event["id"]] = event["outcome"]
        elif name == "ack" and event["result"] in {"applied", "not_covered"}:
            self.acknowledged += 1
        elif name == "text" and event["text"].startswith("Known place again"):
            self.history_matches += 1
        elif name == "summary":
            self.summaries += 1
            self.received.setdefault(event["frame_id"], at)
        elif name == "state":
            if event["state"] == "blocked" and self.state != "blocked":
                self.blocked += 1
            self.state = event["state"]

    def asked_about(self, call: dict[str, Any], shown: Shown, metres: float) -> str:
        """Counts what a new call is about, and says it in a line. metres: that the rover has driven."""
        thing, place = _about(call, shown)
        if thing is not None and shown.thing is not None:
            self.things.add(shown.thing)
        if place is not None:
            self.places.add(place)
        again = self.asked_before.asks_again(metres, thing, place)
        self.repeat_calls += again
        named = " and ".join(filter(None, (place, thing)))
        return f"call {call['id']} is about {named or 'nothing'}{', AGAIN' if again else ''}"

    def answered(self, call: dict[str, Any], shown: Shown, metres: float) -> None:
        """Takes in that a call was answered. metres: that the rover has driven."""
        self.asked_before.answered(metres, *_about(call, shown))

    def typed(self, line: str) -> None:
        """An answer that the operator gave."""
        if "tap" in line:
            self.taps += 1
        elif ":" in line:
            self.words += 1

    def figures(
        self, field_status: dict[str, Any], daemon_status: dict[str, Any], seconds: float
    ) -> dict[str, Any]:
        """The demo's last line. latency: capture to the moment the operator's side had the summary."""
        captured = {frame_id: at for frame_id, at, _ in daemon_status.get("recent", [])}
        latencies = [
            1000 * (at - captured[frame_id]) for frame_id, at in self.received.items() if frame_id in captured
        ]
        modes = [(entry["mode"], entry["by"]) for entry in field_status["mode_log"]]
        frames = daemon_status.get("frames", 0)
        judged = [at for _, _, at in daemon_status.get("recent", [])] or [0.0]
        judging = daemon_status.get("judging", {})
        return {
            "frames": frames,
            "fps": round((len(judged) - 1) / max(1e-3, judged[-1] - judged[0]), 2),
            "fps_aimed_at": judging.get("rate"),
            "slowed_down": self.slowed_down,
            "calls": len(self.calls),
            "calls_unknown_object": sum(r == ["unknown_object"] for r in self.calls.values()),
            "calls_unknown_scene": self.calls_for_places,
            "answers": self.acknowledged,
            "answers_by_tap": self.taps,
            "answers_by_words": self.words,
            "things": len(self.things),
            "places": len(self.places),
            "repeat_calls": self.repeat_calls,
            "closed_unanswered": sum(outcome == "passed" for outcome in self.closed.values()),
            "history_matches": self.history_matches,
            "returned_without_call": self.returned_without_call,
            "holds": modes.count(("HOLD", "companion")),
            "resumes": sum(
                before == ("HOLD", "companion") and after == ("AUTO", "companion")
                for before, after in pairwise(modes)
            ),
            "taken_over": self.taken_over,
            "driven_round": self.driven_round,
            "blocked": self.blocked,
            "kept_off_named_things": self.kept_off,
            "collisions": len(field_status["contacts"]),
            "bytes_per_s": round(field_status["bytes"]["gcs"]["from_companion"] / max(1e-3, seconds), 1),
            "summaries_received": self.summaries,
            "latency_ms_p50": round(median(latencies), 1) if latencies else None,
            "latency_ms_max": round(max(latencies), 1) if latencies else None,
            "seconds": round(seconds, 1),
        }


def _about(call: dict[str, Any], shown: Shown) -> tuple[str | None, str | None]:
    """Returns the thing or patch of ground, and the place, that a call is about."""
    thing = shown.id if "unknown_object" in call["reasons"] else None
    return thing, shown.zone if "unknown_scene" in call["reasons"] else None
