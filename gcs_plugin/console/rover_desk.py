"""What the console knows of one rover: live figures, words, calls, files, a timeline. No I/O, no clock."""

from __future__ import annotations

import io
import re
from collections import deque
from collections.abc import Mapping
from typing import Any

from companion.wire.ids import Policy, Stage, State, newest_first, words_hash
from companion.wire.parameters import ROI, THR_ROI, THR_SCENE, THR_TILE, THR_TRAV
from gcs_plugin.client import events as ev
from gcs_plugin.client.client import OperatorClient
from gcs_plugin.client.documents import Check, KnownPlace, StateFile, read_checks, read_record, read_state
from gcs_plugin.client.rovers import Call, Rover
from gcs_plugin.console.calls import Stories, Story
from gcs_plugin.console.files import Files, Rank
from gcs_plugin.terminal import wording
from gcs_plugin.terminal.output import ALARM, GOOD, TextOutput, plain
from gcs_plugin.terminal.pictures import jpeg_size

POINTS = 300
"""Summaries that are plotted: five minutes."""
ENTRIES = 300
STATE_AGAIN_S, STATE_LONGEST_S = 5.0, 80.0
"""Seconds between two readings of /state.json: twice as long each time that it left something untold."""
QUICK = 3000.0
"""Bytes a second from which a large picture is fetched without being asked for."""
LARGE_BYTES = 65_000
"""About what a large picture has."""
STATE_PATH, CHECK_PATH, CALLS_PATH = "/state.json", "/check.json", "/calls/"
EARLIER = 8
"""Calls before this console began that are fetched."""
_RECORD = re.compile(r"([0-9]{1,5})\.json", re.ASCII)
_NAMED = re.compile(r"(?:tap )?([^:]{1,48}): (-?[0-9.]{1,6})(?: |$)", re.ASCII)
_TONES = {ALARM: "bad", GOOD: "good"}
_PROMPTS_STATE = (ev.StateChanged, ev.PolicyStatusChanged, ev.Acknowledged, ev.CallClosed)


class RoverDesk:
    """Follows one rover. `take` its events, then `step`; `document` is what the page shows."""

    def __init__(self, client: OperatorClient, system: int) -> None:
        self.system = system
        self.files = Files(client, system)
        self.stories = Stories(system)
        self.points: deque[tuple[float, float | None, float | None, float | None, float | None]] = deque(
            maxlen=POINTS
        )
        self.timeline: deque[dict[str, Any]] = deque(maxlen=ENTRIES)
        self.entries = 0
        """How many entries the timeline ever had."""
        self.summaries = 0
        """How many points there ever were."""
        self.words: dict[str, float] = {}
        """Weight by word, of those in use, as far as known."""
        self.named: dict[str, float] = {}
        """Words that operators gave as answers, the newest last."""
        self.state: StateFile | None = None
        self.checks: tuple[Check, ...] = ()
        self.checked_at: float | None = None
        self.earlier = "unknown"
        """Whether the calls before this console began are "unknown", "coming" or "known"."""
        self.place_picture = b""
        """The picture of the known place, JPEG, b"" without one."""
        self._client = client
        self._output = TextOutput(io.StringIO(), colours=False)
        self._state_wanted = False
        self._state_at = float("-inf")
        self._state_pause = STATE_AGAIN_S

    @property
    def rover(self) -> Rover:
        return self._client.rovers[self.system]

    def take(self, event: ev.Event, now: float, wall: float) -> None:
        """Take in an event of this rover. wall: seconds since 1970."""
        if isinstance(event, ev.SummaryReceived):
            self._plot(now)
            return
        if isinstance(event, _PROMPTS_STATE) or (isinstance(event, ev.LinkChanged) and event.up):
            self._state_wanted = True
        if isinstance(event, ev.TextReceived):
            self.stories.hear(event.text, wall)
        if isinstance(event, ev.ParameterReceived | ev.NotUnderstood) and not isinstance(
            event, ev.NotUnderstood
        ):
            return
        self._note(event, now, wall)

    def step(self, now: float, wall: float) -> bool:
        """Ask for files that are needed, and take those that came. Returns whether something changed."""
        rover = self.rover
        for story in self.stories.follow(rover, wall, now):
            self._want_small(story, rover)
        for call in rover.calls.values():
            self._follow_call(call)
        if rover.alive(now):
            self._want_state(rover, now)
        return self.files.step(now)

    def fetch(self, what: str, call: int) -> str:
        """Fetch a file on request; returns why that cannot be, or ""."""
        if what == "check":
            self.files.want(CHECK_PATH, Rank.CHECK, self._take_checks)
            return ""
        if what == "calls":
            self._want_earlier()
            return ""
        story = self.stories.by_id.get(call)
        if story is None:
            return f"call {call} is not known here"
        self._want_large(story)
        return ""

    def document(self, now: float, ids: tuple[int, int] | None) -> dict[str, Any]:
        """Return all that the page shows, but for points and timeline. Times are those of `now`."""
        rover, state = self.rover, self.state
        counters, summary, computer = rover.counters, rover.summary, rover.computer
        heard = counters.summaries + counters.summaries_lost
        calls = self.stories.documents(rover, now, ids)
        lost = self.earlier == "coming" and not self.files.waits(CALLS_PATH)
        return {
            "system": self.system,
            "up": rover.alive(now),
            "heard": None if not rover.known else round(now - rover.silence(now), 2),
            "state": "" if rover.state is None else plain(rover.state),
            "elsewhere": rover.state is State.HOLDING and not rover.current_id,
            "current": rover.current_id,
            "policy": "" if rover.policy is None else plain(rover.policy),
            "signs": rover.signs,
            "vehicle": None if rover.vehicle is None else plain(rover.vehicle),
            "link": {
                "bytes": counters.bytes,
                "summaries": counters.summaries,
                "lost": counters.summaries_lost / heard if heard else None,
                "dropped": 0 if summary is None else summary.dropped,
                "unreadable": counters.unreadable,
                "rate": self.files.rate and round(self.files.rate),
            },
            "ahead": summary and {
                "frame_age": summary.frame_age_ms,
                "latency": summary.latency_ms,
                "field_of_view": summary.field_of_view,
                "sectors": summary.sectors,
                "reasons": plain(summary.reasons),
            },
            "thresholds": self._thresholds(),
            "words": self._words(),
            "words_known": self._words_are_known(rover),
            "names": [[word, weight] for word, weight in reversed(self.named.items())],
            "known_place": self._known_place(),
            "hold_refused": wording.clean(state.hold_refused) if state is not None else "",
            "held_by": wording.clean(state.held_by) if state is not None else "",
            "model": wording.clean(state.model) if state is not None else "",
            "version": wording.clean(state.version) if state is not None else "",
            "computer": "" if computer is None else wording.computer(computer, now),
            "shadow": wording.shadow(rover) if rover.policy is Policy.SHADOW else "",
            "checks": [
                {"check": wording.clean(one.name), "verdict": one.verdict, "text": wording.clean(one.text)}
                for one in self.checks
                if one.verdict in ("fail", "warn")
            ],
            "checked": self.checked_at,
            "earlier": "unknown" if lost else self.earlier,
            "calls": [call | self._large(call["id"]) for call in calls],
            "texts": [
                {"severity": severity, "text": wording.clean(text)}
                for _, severity, text in list(rover.texts)[-6:]
            ],
        }  # fmt: skip

    def _plot(self, now: float) -> None:
        summary = self.rover.summary
        if summary is not None:
            self.summaries += 1
            self.points.append((
                round(now, 2), summary.roi_traversability, summary.roi_uncertainty, summary.worst_tile,
                summary.similarity,
            ))  # fmt: skip

    def _note(self, event: ev.Event, now: float, wall: float) -> None:
        call = 0
        match event:
            case ev.CallOpened(call=data) | ev.CallChanged(call=data):
                call = data.id
                lines, tone = [wording.headline(data, data.age_s)], "call"
            case _:
                lines, colour = self._output.lines(event, now)
                tone = _TONES.get(colour, "")
                if isinstance(event, ev.CallClosed):
                    call = event.call.id
        if lines:
            self.entries += 1
            self.timeline.append(
                {"n": self.entries, "at": round(wall, 2), "tone": tone, "text": lines[0], "call": call}
            )

    def _follow_call(self, call: Call) -> None:
        story = self.stories.by_id.get(call.data.id)
        if story is None:
            return
        if call.open and call.data.picture and "small" in story.pictures and self._is_quick():
            self._want_large(story)
        if story.record is None and self.stories.others_were_first(call):
            self._want_record(story)

    def _want_small(self, story: Story, rover: Rover) -> None:
        call = rover.calls.get(story.id)
        if call is not None and call.data.picture:
            self.files.put_back(Rank.CALL_PICTURE)
            self.files.want(call.data.picture, Rank.CALL_PICTURE, lambda jpeg: story.keep("small", jpeg))

    def _want_large(self, story: Story) -> None:
        path = _large_path(story.id)
        if "large" not in story.pictures and path not in self.files.problems:
            self.files.want(path, Rank.LARGE_PICTURE, lambda jpeg: story.keep("large", jpeg))

    def _want_record(self, story: Story) -> None:
        def take(content: bytes) -> None:
            story.record = read_record(content)

        path = f"/calls/{story.id}.json"
        if path not in self.files.problems:
            self.files.want(path, Rank.RECORD, take)

    def _is_quick(self) -> bool:
        return (self.files.rate or 0.0) >= QUICK

    def _want_state(self, rover: Rover, now: float) -> None:
        missing = rover.current_id and not _is_open(rover.calls.get(rover.current_id))
        missing = missing or not self._words_are_known(rover)
        if self._state_wanted or not missing:
            self._state_pause = STATE_AGAIN_S
        wanted = self._state_wanted or missing
        if wanted and now - self._state_at >= self._state_pause and not self.files.waits(STATE_PATH):
            self._state_pause = min(2 * self._state_pause, STATE_LONGEST_S)
            self._state_wanted, self._state_at = False, now
            self.files.want(STATE_PATH, Rank.STATE, lambda content: self._take_state(content, now))

    def _take_state(self, content: bytes, asked_at: float) -> None:
        state = read_state(content)
        if state.starting:
            return
        self._see_place(state.known_place)
        self.state = state
        self.words = dict(state.words)
        rover, call = self.rover, state.open_call
        known = None if call is None else rover.calls.get(call.id)
        if call is not None and call.id == rover.current_id and not _is_open(known):
            rover.handle_call(call, asked_at)
        if self._is_quick():
            if self.checked_at is None:
                self.files.want(CHECK_PATH, Rank.CHECK, self._take_checks)
            if self.earlier == "unknown":
                self._want_earlier()

    def _see_place(self, known: KnownPlace | None) -> None:
        """Fetch the picture of a known place, when another one came into force."""
        before = self.state.known_place if self.state is not None else None
        if (known and known.picture) == (before and before.picture):
            return
        self.place_picture = b""

        def take(jpeg: bytes) -> None:
            if jpeg_size(jpeg) is not None:
                self.place_picture = jpeg

        if known is not None and known.picture:
            self.files.want(known.picture, Rank.RECORD, take)

    def _want_earlier(self) -> None:
        """List the rover's calls, then fetch the records and small pictures of the newest."""
        self.earlier = "coming"
        self.files.want(CALLS_PATH, Rank.OLD, self._take_list)

    def _take_list(self, names: bytes) -> None:
        self.earlier = "known"
        listed = (_RECORD.fullmatch(name) for name in names.decode().splitlines())
        numbers = newest_first([int(found[1]) for found in listed if found])
        for number in numbers[:EARLIER]:
            if number not in self.stories.by_id:
                self.files.want(f"/calls/{number}.json", Rank.OLD, self._take_record)

    def _take_record(self, content: bytes) -> None:
        record = read_record(content)
        story = self.stories.remember(record)
        if story is not None and record.picture:
            self.files.want(record.picture, Rank.OLD, lambda jpeg: story.keep("small", jpeg))
        for one in record.answers:
            for operation in one.operations:
                if found := _NAMED.match(operation):
                    self.named.setdefault(found[1], float(found[2]))

    def _take_checks(self, content: bytes) -> None:
        self.checks = read_checks(content)
        self.checked_at = 0.0

    def note_named(self, words: Mapping[str, float]) -> None:
        """Take note of words that an operator gave as an answer."""
        for word, weight in words.items():
            self.named.pop(word, None)
            self.named[word] = weight
            if len(self.named) > 24:
                self.named.pop(next(iter(self.named)))

    def _thresholds(self) -> dict[str, Any]:
        settings = {**(self.state.settings if self.state is not None else {}), **self.rover.parameters}
        named = {"trav": THR_TRAV, "unc": THR_ROI, "tile": THR_TILE, "scene": THR_SCENE}
        found: dict[str, Any] = {
            name: value
            for name, parameter in named.items()
            if (value := settings.get(parameter)) is not None and value >= -1
        }
        roi = [settings.get(parameter) for parameter in ROI.values()]
        return found | {"roi": roi if None not in roi else None}

    def _words(self) -> list[dict[str, Any]]:
        vocabulary = self.state.vocabulary if self.state is not None else ()
        used = [{"word": word, "weight": weight, "fixed": word in vocabulary}
                for word, weight in self.words.items()]  # fmt: skip
        others = [
            {"word": word, "weight": None, "fixed": True} for word in vocabulary if word not in self.words
        ]
        return used + others

    def _words_are_known(self, rover: Rover) -> bool:
        if self.state is None:
            return False
        return rover.summary is None or rover.summary.words == words_hash(self.words)

    def _known_place(self) -> dict[str, Any] | None:
        known = self.state.known_place if self.state is not None else None
        if known is None:
            return None
        return {
            "call": known.call_id,
            "similarity": known.similarity,
            "needed": known.needed,
            "changed": {word: list(pair) for word, pair in known.changed.items()},
            "picture": f"/pictures/{self.system}/{known.call_id or 0}/place.jpg"
            if self.place_picture
            else "",
        }

    def _large(self, number: int) -> dict[str, Any]:
        """How the pictures of a call come: why not, progress, or how long the large one would take."""
        path = _large_path(number)
        small = self.files.problems.get(f"/calls/{number}.jpg", "")
        return {
            "small_problem": small and f"Its picture did not come: {small}.",
            "large": {
                "waits": self.files.waits(path),
                "progress": self.files.progress(path),
                "seconds": None if not self.files.rate else round(LARGE_BYTES / self.files.rate),
                "problem": self.files.problems.get(path, ""),
            },
        }


def _large_path(number: int) -> str:
    return f"/calls/{number}-large.jpg"


def _is_open(call: Call | None) -> bool:
    return call is not None and call.data.stage is not Stage.CLOSED
