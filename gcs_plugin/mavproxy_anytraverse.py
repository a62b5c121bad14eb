"""Shows rovers' calls and sends answers in MAVProxy: `module load gcs_plugin.mavproxy_anytraverse`.

It prints the calls of every companion on every link, whichever vehicle is MAVProxy's target. `at help` lists
what can be typed.
"""

from __future__ import annotations

import re
import time
import traceback
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from MAVProxy.modules.lib import mp_module
from pymavlink.dialects.v20.common import MAV_SEVERITY_ERROR

from companion.wire.ids import AUTOPILOT_COMPONENT_ID, COMPONENT_ID, Policy
from gcs_plugin.client import events as ev
from gcs_plugin.client.client import OperatorClient
from gcs_plugin.client.rovers import ECHO_S
from gcs_plugin.terminal import wording
from gcs_plugin.terminal.output import TextOutput
from gcs_plugin.terminal.pictures import Pictures
from gcs_plugin.terminal.session import Session

NAMES = ("anytraverse", "at")
CYCLE_S = 0.05
"""Least time between two steps of the client: MAVProxy calls `idle_task` several hundred times a second."""
MAX_PROBLEMS = 16
MOST_TEXTS = 32
REPEATED_WITHIN_S = 2.0
"""Within this time the autopilot's script has repeated a text of severity ERROR or worse."""
UNSIGNED = "rover {} believes only what is signed; type this first: signing key PASSPHRASE"
HELP = """\
  at go | stay | look          answer the current call; `at 7 go` or `at answer 7 go` answers call 7
  at set bush -1               a word and its weight: 1 drive over it, -1 never; also `at bush: -1, grass: 1`
  at bush: -1, go              any change, and drive on; also `at tap drum -1 go`
  at tap drum -1               what the call points at is a "drum"; a box: at tap drum -1 0.40 0.55 0.60 0.80
  at forget bush               take a word out of use; `at forget call 7`: what it taught; `at new episode`
  at other place               the place that "matches" is another one; `at other place 7`: that of call 7
  at picture                   fetch what the call saw, to tap in it; `at picture 7`, `7 large`, `7 raw`
  at picture ground            fetch what is known of the ground round the rover, from above
  at incident 7                have a file of call 7 packed on the rover; `at cancel incident 7`: no more
  at policy hold               what the companion may do: report, shadow, hold, guide; off: nobody watches
  at rover 2 go                for one of several rovers; `at rover 2` alone stays with it
  at status | calls | words    what is known; `anytraverse` is the long form of `at`""".splitlines()
_BETWEEN_CHANGES = re.compile(r"(?<=\d),(?=\s)")
_MOTIONS = ["go", "stay", "look"]
_COMPLETIONS = [
    "<status|calls|words|help|go|stay|look>",
    f"policy <{'|'.join(policy.name.lower() for policy in Policy)}>",
    "other place (AT_CALL)",
    "answer (AT_CALL) <go|stay|look>",
    "picture (AT_CALL) <large|raw>",
    "picture ground",
    "incident (AT_CALL)",
    "cancel incident (AT_CALL)",
    "<set|forget|tap> (AT_WORD) <1|-1>",
]


def typed_line(arguments: Sequence[str]) -> str:
    """Turn the arguments of `at` into an operator's line.

    A comma after a number stands for `;`, since MAVProxy splits its own command lines at `;`.
    """
    first, *rest = _BETWEEN_CHANGES.sub(";", " ".join(arguments)).split()
    if first == "answer" and rest:
        return " ".join(rest)
    if first == "set" and len(rest) > 1:
        return f"{' '.join(rest[:-1]).removesuffix(':')}: {rest[-1]}"
    return " ".join((first, *rest))


class _Console:
    """Writes whole lines to MAVProxy's console, which MAVProxy may replace at any time."""

    def __init__(self, mpstate: Any) -> None:
        self._mpstate = mpstate
        self._line = ""

    def write(self, text: str) -> None:
        *lines, self._line = (self._line + text).split("\n")
        for line in lines:
            self._mpstate.console.writeln(line)

    def flush(self) -> None:
        """Do nothing: the console shows every line at once."""


class _Output(TextOutput):
    """Leaves out texts that MAVProxy prints as "AP: ...": the companion's, or its script's repeat."""

    def __init__(self, console: _Console) -> None:
        super().__init__(console, colours=False, before="at ")
        self._printed: deque[tuple[float, int, str]] = deque(maxlen=MOST_TEXTS)
        self._waiting: deque[tuple[float, ev.TextReceived, bool]] = deque()

    def printed_by_mavproxy(self, system: int, text: str, now: float) -> None:
        """Take note of a text that MAVProxy prints."""
        self._printed.append((now, system, text))

    def event(self, event: ev.Event, now: float, *, several: bool) -> None:
        """Show an event; a text once it is known that MAVProxy does not print it."""
        if isinstance(event, ev.TextReceived) and len(self._waiting) < MOST_TEXTS:
            wait = REPEATED_WITHIN_S if event.severity <= MAV_SEVERITY_ERROR else 0.0
            self._waiting.append((now + wait, event, several))
        else:
            super().event(event, now, several=several)

    def show_due(self, now: float) -> None:
        """Show the texts that MAVProxy has not printed meanwhile."""
        while self._waiting and self._waiting[0][0] <= now:
            _, event, several = self._waiting.popleft()
            printed = {(system, text) for at, system, text in self._printed if now - at < ECHO_S}
            if (event.system, event.text) not in printed:
                super().event(event, now, several=several)


class AnyTraverseModule(mp_module.MPModule):  # type: ignore[misc]  # MAVProxy has no types
    """Passes MAVProxy's messages to the operator's client, and the client's messages to the links."""

    def __init__(self, mpstate: Any) -> None:
        # MAVProxy finds a module to reload or unload by the name given to `module load`: the import name.
        super().__init__(mpstate, __name__, "what rovers ask, and your answers", multi_vehicle=True)
        self._client = OperatorClient()
        self._output = _Output(_Console(mpstate))
        self._session = Session(self._client, self._output, keep=Pictures(Path()).keep)
        self._next_at = float("-inf")
        self._problems: set[str] = set()
        self._unsigned: set[int] = set()
        for name in NAMES:
            self.add_command(name, self.command, "answer what rovers ask (AnyTraverse)", _COMPLETIONS)
        self.add_completion_function("(AT_CALL)", self._call_ids)
        self.add_completion_function("(AT_WORD)", self._words)

    def mavlink_packet(self, message: Any) -> None:
        """Take in every message of every vehicle on every link."""
        if message.get_type() == "STATUSTEXT" and self.message_is_from_primary_vehicle(message):
            self._output.printed_by_mavproxy(message.get_srcSystem(), message.text, time.monotonic())
            if message.get_srcComponent() == AUTOPILOT_COMPONENT_ID:
                return
        with self._reporting_errors():
            self._client.receive(message, time.monotonic())

    def idle_task(self) -> None:
        """Send what is due, and print events."""
        now = time.monotonic()
        if now < self._next_at:
            return
        self._next_at = now + CYCLE_S
        with self._reporting_errors():
            for message in self._client.outgoing(now):
                self._send(message)
            self._session.step(now)
            self._output.show_due(now)

    def command(self, arguments: Sequence[str]) -> None:
        """Run the command `at ...`."""
        if not arguments or list(arguments) == ["help"]:
            self._output.say(HELP)
        elif list(arguments) == ["quit"]:
            self._output.problem(f"this ends it: module unload {self.name}")
        else:
            with self._reporting_errors():
                self._session.type(typed_line(arguments), time.monotonic())

    def unload(self) -> None:
        """Remove the commands, and report the answers that are given up."""
        for name in NAMES:
            self.remove_command(name)
        for name in ("(AT_CALL)", "(AT_WORD)"):
            self.mpstate.completion_functions.pop(name, None)
        for pending in self._client.unsettled:
            self._output.problem(wording.given_up(pending.answer.target))
        super().unload()

    def _send(self, message: Any) -> None:
        """Send a message on the links on which that companion was heard."""

        def send(mav: Any) -> None:
            self._client.ids = mav.srcSystem, mav.srcComponent
            self._warn_of_unsigned(message.target_system, mav)
            mav.send(message)

        self.mpstate.foreach_mav(message.target_system, COMPONENT_ID, send)

    def _warn_of_unsigned(self, system: int, mav: Any) -> None:
        rover = self._client.rovers.get(system)
        if rover is None or not rover.signs or system in self._unsigned:
            return
        if not getattr(getattr(mav, "signing", None), "secret_key", None):
            self._unsigned.add(system)
            self._output.problem(UNSIGNED.format(system))

    @contextmanager
    def _reporting_errors(self) -> Iterator[None]:
        """Print an error once instead of raising it: MAVProxy drops a module's errors silently."""
        try:
            yield
        except Exception as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            problem = f"{type(error).__name__}: {error} ({place.filename}:{place.lineno})"
            if problem not in self._problems and len(self._problems) < MAX_PROBLEMS:
                self._problems.add(problem)
                self._output.problem(f"this is a mistake in the module, please report it: {problem}")

    def _call_ids(self, _text: str) -> list[str]:
        rovers = self._client.rovers.values()
        return [str(call.data.id) for rover in rovers for call in rover.open_calls()] + _MOTIONS

    def _words(self, _text: str) -> list[str]:
        return [word for rover in self._client.rovers.values() for word in rover.words()]


def init(mpstate: Any) -> AnyTraverseModule:
    """Make the module; MAVProxy calls this to load it."""
    return AnyTraverseModule(mpstate)
