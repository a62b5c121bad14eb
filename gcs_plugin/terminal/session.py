"""Runs an operator's session: carries out typed lines, shows events, lets a script answer. No I/O."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from statistics import median
from typing import Any

from companion.wire.answers import Answer
from companion.wire.delivery import DeliveryStatus
from companion.wire.ids import Result
from companion.wire.packing import PayloadError
from companion.wire.typed_answers import CommandError, WeightMissingError
from companion.wire.words_text import own_weight, turned
from gcs_plugin.client import events as ev
from gcs_plugin.client.client import OperatorClient
from gcs_plugin.client.fetch import Fetch, FetchStatus
from gcs_plugin.client.rovers import TrackedRover
from gcs_plugin.terminal import wording
from gcs_plugin.terminal.commands import FetchPicture, Select, SetPolicy, Show, parse
from gcs_plugin.terminal.output import Output, plain
from gcs_plugin.terminal.resolve import address, choose_rover, picture_of
from gcs_plugin.terminal.script import Script
from gcs_plugin.terminal.state_files import StateFiles


class SessionStatistics:
    """Counts events for the figures at the session's end."""

    def __init__(self) -> None:
        self._calls = 0
        self._by_reason: Counter[str] = Counter()
        self._by_outcome: Counter[str] = Counter()
        self._sent = 0
        self._acknowledged = 0

    def add(self, event: ev.Event) -> None:
        """Count an event."""
        match event:
            case ev.CallAnnounced():
                self._calls += 1
                self._by_reason.update(plain(event.call.reasons))
            case ev.CallEnded():
                self._by_outcome[plain(event.call.outcome)] += 1
            case ev.AnswerStatusChanged() if event.status is DeliveryStatus.SENT:
                self._sent += 1
            case ev.Acknowledged() if event.acknowledgement.result is not Result.BUSY:
                self._acknowledged += 1
            case _:
                pass

    def record(self, rovers: Mapping[int, TrackedRover], seconds: float) -> dict[str, Any]:
        """Return the figures as an object. latency_ms: capture to sending, as measured by the rovers."""
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
            "not_understood": sum(counter.unreadable for counter in counters),
            "latency_ms": {
                "p50": median(latencies) if latencies else None,
                "max": max((counter.latency_max_ms for counter in counters if latencies), default=None),
            },
        }


PROGRESS_S = 3.0
HELP = """\
  go, or ok                drive on; the thing in the call is accepted once
  stay                     keep standing, stop the alarm; teaches nothing
  look                     look again
  bush: -1                 a word and its weight: 1 drive over it, -1 never. Several: bush: -1; grass: 1
  tap drum -1              what the call points at is a "drum"; with a box: tap drum -1 0.40 0.55 0.60 0.80
  forget bush              take a word out of use; `forget call 7`: what call 7 taught; `new episode`: all
  other place              the place that "matches" is another one: its words go, and it matches so no more
  bush: -1, go             any change, and drive on; also `tap drum -1 go`
  policy hold              what it may do: `report`, `shadow`, `hold`, `guide`; `off`: nobody watches
  picture                  fetch what the call saw, to tap in it; `picture 7`, `7 large`, `7 raw`
  picture ground           fetch what is known of the ground round the rover, from above
  incident 7               have what is known of call 7 packed into a file; `incident`: of the last minute
  cancel incident 7        pack it no more
  7 go                     for call 7 instead of the current one; `rover 2 go`, or `rover 2` to stay there
  status, calls, words, help, quit""".splitlines()


class Session:
    """Connects a client to an output. script: answers calls beside the person.

    keep: stores a fetched picture under a name, and returns where, for a person; None: no pictures.
    """

    def __init__(
        self,
        client: OperatorClient,
        output: Output,
        script: Script | None = None,
        keep: Callable[[str, bytes], str] | None = None,
    ) -> None:
        self.quit = False
        self.totals = SessionStatistics()
        self._client = client
        self._output = output
        self._script = script
        self._keep = keep
        self._fetches: dict[str, Fetch] = {}
        self._progress_shown_at = 0.0
        self._selected: int | None = None
        self._state_files = StateFiles(client)
        self._turning: tuple[str, int, Answer] | None = None
        """The question about words that the last answer would turn, the rover, and that answer."""

    def step(self, now: float) -> None:
        """Show events and the progress of pictures, then let the script answer."""
        rovers = self._client.rovers
        for event in self._client.events():
            self.totals.add(event)
            self._output.event(event, now, several=len(rovers) > 1)
            came = rovers.get(event.system) if isinstance(event, ev.LinkChanged) and event.up else None
            if came is not None and not came.parameters:
                self._client.request_parameters(came.system)
        for name, fetch in list(self._fetches.items()):
            self._check_fetch(name, fetch, now)
        for rover in rovers.values():
            if not any(fetch.system == rover.system for fetch in self._fetches.values()):
                self._state_files.step(rover, now)
            if self._script is not None and rover.alive(now):
                self._answer_by(self._script, rover, now)

    def type(self, line: str, now: float, *, by_person: bool = True) -> None:
        """Carry out one typed line, or show why not."""
        try:
            named, command = parse(line) or (None, None)
            match command:
                case Answer():
                    self._answer(command, self._meant(named), now, by_person=by_person)
                case Select():
                    self._selected = choose_rover(self._client.rovers, named).system
                    self._output.say([f"lines now mean rover {self._selected}"])
                case SetPolicy():
                    self._client.set_policy(self._meant(named).system, command.policy, now)
                case FetchPicture():
                    self._fetch(command, named, now)
                case Show():
                    self._show(command.what, named, now)
        except WeightMissingError as error:
            self._output.problem(str(self._with_own_weight(error)))
        except (CommandError, PayloadError) as error:
            self._output.problem(str(error))

    def _with_own_weight(self, error: WeightMissingError) -> WeightMissingError:
        """Propose the weight that the word has, where a rover knows it."""
        word = " ".join(error.word.lower().split())
        for rover in self._client.rovers.values():
            weight = own_weight(word, rover.words(), rover.given())
            if weight is not None:
                return WeightMissingError(error.word, f"{word}: {weight:g}")
        return error

    def _meant(self, named: int | None) -> TrackedRover:
        """Return the rover that a line means; `named` is the one that it names. Raises CommandError."""
        return choose_rover(self._client.rovers, named, self._selected)

    def _answer(self, typed: Answer, rover: TrackedRover, now: float, *, by_person: bool) -> None:
        answer = typed
        if not typed.about_files:
            answer = address(typed, rover, now)
            self._refuse_turning(answer, rover, by_person=by_person)
        self._client.answer(rover.system, answer, now)

    def _refuse_turning(self, answer: Answer, rover: TrackedRover, *, by_person: bool) -> None:
        """Raise CommandError for an answer that turns a sign, unless a person repeats it."""
        state = rover.state_file
        matched = state.known_place.changed if state is not None and state.known_place is not None else {}
        read = state is not None
        question = turned(answer.operations, rover.words(), rover.given(), matched, read=read)
        if not by_person:
            if question:
                raise CommandError(f"{question}. A table turns no sign: type it yourself")
            return
        asked, self._turning = self._turning, (question, rover.system, answer) if question else None
        if question and asked != self._turning:
            raise CommandError(question)
        self._turning = None

    def _fetch(self, picture: FetchPicture, named: int | None, now: float) -> None:
        if self._keep is None:
            raise CommandError("pictures are not fetched here: `ftp get /calls/7.jpg` does it")
        rover = self._meant(named)
        path, name = picture_of(picture, rover)
        same = [one for one, fetch in self._fetches.items() if fetch.system == rover.system]
        for replaced in same:
            del self._fetches[replaced]
        self._fetches[name] = self._client.fetch(rover.system, path, now)
        self._state_files.stop(rover.system)
        self._progress_shown_at = now
        self._output.say([f"{path} is asked for"])

    def _check_fetch(self, name: str, fetch: Fetch, now: float) -> None:
        if fetch.status is FetchStatus.DONE and self._keep is not None:
            try:
                self._output.say([f"picture  {self._keep(name, fetch.content)}"])
            except OSError as error:
                self._output.problem(f"the picture cannot be kept: {error}")
        elif fetch.status is FetchStatus.FAILED:
            self._output.problem(f"{fetch.path} did not come: {fetch.problem}")
        elif now - self._progress_shown_at >= PROGRESS_S:
            self._progress_shown_at = now
            size = "" if fetch.size is None else f" of {fetch.size}"
            self._output.say([f"{fetch.path}: {fetch.received}{size} bytes"])
        if fetch.settled:
            del self._fetches[name]

    def _show(self, what: str, named: int | None, now: float) -> None:
        if what == "quit":
            self.quit = True
        elif what == "help":
            self._output.say(HELP)
        else:
            self._output.say(self._lines(what, named, now))

    def _lines(self, what: str, named: int | None, now: float) -> list[str]:
        rovers = self._client.rovers
        chosen = list(rovers.values()) if named is None else [choose_rover(rovers, named)]
        if not chosen:
            return ["no rover is heard yet"]
        if what == "calls":
            return [line for rover in chosen for line in wording.calls_lines(rover, now)]
        if what == "words":
            for rover in chosen:
                self._client.request_parameters(rover.system)
            return [line for rover in chosen for line in wording.words_lines(rover)]
        return [line for rover in chosen for line in wording.status_lines(rover, now)]

    def _answer_by(self, script: Script, rover: TrackedRover, now: float) -> None:
        busy = {pending.answer.target for pending in self._client.unsettled if pending.system == rover.system}
        for call in rover.open_calls():
            if call.data.id in busy:
                continue
            line = script.answer(rover.system, call, now, words_read=rover.state_file is not None)
            if line is not None:
                typed = f"rover {rover.system} {call.data.id} {line}"
                self._output.typed(typed)
                self.type(typed, now, by_person=False)
