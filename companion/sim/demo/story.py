"""Prints the demo's events for a newcomer, one line each."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TextIO

_REASONS = {
    "unknown_scene": "this place looks like none that it was told about",
    "unknown_object": "something here fits none of its words",
    "blocked": "what it knows here is not drivable",
    "fault": "it cannot see",
}


QUIET = 7.0
"""Seconds without a line after which one says what it does."""
_LOOKS = 0.5


class Story:
    """Prints lines that begin with the time and the rover's place.

    clock: print the time of day, as the operator's terminal does, instead of seconds since the start.
    doing: what is said after `QUIET` s without a line, "": nothing.
    """

    def __init__(self, stream: TextIO = sys.stdout, *, clock: bool = False) -> None:
        self._stream = stream
        self._clock = clock
        self._mode = ""
        self._contacts = 0
        self._printing = threading.Lock()
        self._printed_at = self.began = time.monotonic()
        self.where = self.doing = ""

    @contextmanager
    def signs_of_life(self) -> Iterator[None]:
        """Within the block a thread says what it does, so that nobody takes the demo for dead."""
        over = threading.Event()

        def watch() -> None:
            while not over.wait(_LOOKS):
                self.tick(time.monotonic())

        thread = threading.Thread(target=watch, name="signs of life", daemon=True)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()

    def tick(self, now: float) -> None:
        """Says what it does where no line was printed for `QUIET` s. now: monotonic seconds."""
        if self.doing and now - self._printed_at >= QUIET:
            self.log(now - self.began, self.doing)

    def log(self, seconds: float, text: str) -> None:
        """Prints one line. seconds: since the start."""
        line = f"{seconds:6.1f} s  {self.where:<14} {text}"
        if self._clock:
            line = f"{time.strftime('%H:%M:%S')}  {f'[{self.where}] ' if self.where else ''}{text}"
        self.plain(line)

    def plain(self, text: str = "") -> None:
        """Prints a line without a time."""
        with self._printing:
            print(text, file=self._stream, flush=True)
            self._printed_at = time.monotonic()

    def event(self, event: dict[str, Any], seconds: float) -> None:
        """Prints an event of the operator's terminal, if it matters to a newcomer."""
        name = event.get("event")
        if name == "call" and event["kind"] == "call":
            self.log(
                seconds,
                f"CALL {event['id']}: {reasons_of(event)} ({_figures(event)}, frame {event['frame_id']})",
            )
        elif name == "call":
            self.log(seconds, f"HOLD {event['id']}: {_REASONS.get(_first(event), 'not OK')}")
        elif name == "call_changed" and event["stage"] == "clear":
            self.log(seconds, f"{event['id']}: the way is clear now; it asks for a go")
        elif name == "closed" and event["kind"] == "call":
            self.log(seconds, f"call {event['id']} is closed: {event['outcome'].replace('_', ' ')}")
        elif name == "ack":
            self.log(seconds, f"answer {event['result'].replace('_', ' ')}: {event['text']}")
        elif name == "text" and event["text"].startswith("Known place again"):
            self.log(seconds, f"no call: {event['text']}")
        elif name == "state" and event["state"] in {"blocked", "fault"}:
            self.log(seconds, f"state {event['state'].upper()}: {_REASONS[event['state']]}")

    def picture(self, event: dict[str, Any], out: Path, seconds: float) -> None:
        """Prints where a call's large picture is on this computer."""
        if event.get("event") == "call" and event.get("picture"):
            name = Path(str(event["picture"])).stem
            self.log(seconds, f"picture: {out / 'state' / 'calls' / f'{name}-large.jpg'}")

    def field(self, status: dict[str, Any], seconds: float) -> None:
        """Takes in the field's status: updates the place, prints a change of mode and each collision."""
        self.where = f"{status['zone']} {status['distance']:.0f} m"
        if status["mode"] != self._mode:
            by = status["mode_log"][-1]["by"] if status["mode_log"] else "?"
            self.log(seconds, f"rover: {status['mode']} (by {by}), {status['speed']:.1f} m/s")
            self._mode = status["mode"]
        for contact in status["contacts"][self._contacts :]:
            self.log(
                seconds, f"THE ROVER DROVE INTO THE {contact['kind'].upper()}, {contact['speed']:.1f} m/s"
            )
        self._contacts = len(status["contacts"])


def reasons_of(event: dict[str, Any]) -> str:
    """Says why a call was made. event: of the operator's."""
    return " and ".join(_REASONS[reason] for reason in event["reasons"])


def _first(event: dict[str, Any]) -> str:
    return str(event["reasons"][0]) if event["reasons"] else ""


def _figures(event: dict[str, Any]) -> str:
    if event.get("why"):
        return str(event["why"])
    shown = []
    if event.get("roi_uncertainty") is not None:
        shown.append(f"uncertainty {event['roi_uncertainty']:.2f}, worst tile {event['worst_tile']:.2f}")
    if event.get("similarity") is not None:
        shown.append(f"similarity {event['similarity']:.2f}")
    return ", ".join(shown) or "no figures"
