"""What was fetched from one rover by MAVLink FTP, and what is fetched next."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

from anytraverse.picture_size import jpeg_size, picture_size
from companion.pages.wording import named
from companion.wire.call_report import picture_path
from companion.wire.documents import (
    FROM_ABOVE,
    CheckRow,
    KnownPlace,
    StateFile,
    read_checks,
    read_record,
    read_state,
)
from companion.wire.ids import Kind, Stage, newest_first, words_hash
from companion.wire.json_values import DocumentError
from gcs_plugin.client.client import OperatorClient
from gcs_plugin.client.rovers import TrackedCall, TrackedRover
from gcs_plugin.console.calls import CallStory, Stories
from gcs_plugin.console.files import FetchedFiles, Rank

STATE_AGAIN_S, STATE_LONGEST_S = 5.0, 80.0
"""Seconds between two readings of /state.json: twice as long each time that it left something untold."""
QUICK_FOR_RAW, QUICK_FOR_LARGE = 1000.0, 3000.0
"""Bytes a second from which the plain frame and the judged one are fetched without being asked for."""
LARGE_BYTES = 50_000
"""About what the judged frame has; the plain one has 16,000."""
STATE_PATH, CHECK_PATH, CALLS_PATH = "/state.json", "/check.json", "/calls/"
EARLIER = 8
"""Calls before this console began that are fetched."""
MOST_NAMED = 24
MOST_READS = 4
"""How often a call's record is asked for."""
_RECORD = re.compile(r"([0-9]{1,5})\.json", re.ASCII)


class Fetched:
    """Fetches what the page needs: pictures of calls first, then the state, then the rest."""

    def __init__(self, client: OperatorClient, system: int, stories: Stories) -> None:
        self.files = FetchedFiles(client, system)
        self.words: dict[str, float] = {}
        """Weight by word, of those in use, as far as known."""
        self.named: dict[str, float] = {}
        """Words that operators gave as answers, the newest last."""
        self.state: StateFile | None = None
        self.state_wanted = False
        """Whether something happened that /state.json tells more of."""
        self.checks: tuple[CheckRow, ...] = ()
        self.checked = False
        """Whether `checks` were read."""
        self.earlier = "unknown"
        """Whether the calls before this console began are "unknown", "coming" or "known"."""
        self.place_picture = b""
        """The picture of the known place, JPEG, b"" without one."""
        self.ground = b""
        """What was known of the ground when it was asked for, from above: PNG, b"" without one."""
        self.grounds = 0
        """How many of them came."""
        self._stories = stories
        self._state_at = float("-inf")
        self._state_pause = STATE_AGAIN_S

    def fetch(self, what: str, call: int) -> str:
        """Fetch a file on request; returns why that cannot be, or ""."""
        if what == "check":
            self.files.want(CHECK_PATH, Rank.CHECK, self._take_checks)
            return ""
        if what == "ground":
            self.files.want(FROM_ABOVE, Rank.LARGE_PICTURE, self._take_ground)
            return ""
        if what == "calls":
            self._want_earlier()
            return ""
        story = self._stories.by_id.get(call)
        if story is None:
            return f"call {call} is not known here"
        self._want_large(story)
        return ""

    def step(self, rover: TrackedRover, fresh: Iterable[CallStory], now: float) -> bool:
        """Ask for files that are needed, and take those that came. Returns whether something changed.

        fresh: calls that are new.
        """
        for story in fresh:
            self._want_small(story, rover)
        for call in rover.calls.values():
            self._follow_call(call)
        if rover.alive(now):
            self._want_state(rover, now)
        return self.files.step(now)

    def _follow_call(self, call: TrackedCall) -> None:
        story = self._stories.by_id.get(call.data.id)
        if story is None:
            return
        if self._needs_record(story, call):
            self._want_record(story)
        pictured = call.open and call.data.picture and "small" in story.pictures
        if pictured and not self.files.waits(_record_path(story.id)):
            if self._carries(QUICK_FOR_RAW):
                self._want_raw(story, call)
            if self._carries(QUICK_FOR_LARGE):
                self._want_large(story)

    def _want_small(self, story: CallStory, rover: TrackedRover) -> None:
        call = rover.calls.get(story.id)
        if call is not None and call.data.picture:
            self.files.put_back(Rank.CALL_PICTURE)
            self.files.put_back(Rank.LARGE_PICTURE)
            self.files.want(call.data.picture, Rank.CALL_PICTURE, lambda jpeg: story.keep("small", jpeg))

    def _want_large(self, story: CallStory) -> None:
        path = picture_path(story.id, "large")
        if "large" not in story.pictures and path not in self.files.problems:
            self.files.want(path, Rank.LARGE_PICTURE, lambda jpeg: story.keep("large", jpeg))

    def _want_raw(self, story: CallStory, call: TrackedCall) -> None:
        """Fetch the frame without marks, where there is one. A hold has no record that could tell."""
        path = picture_path(story.id, "raw") if call.data.kind is Kind.HOLD else ""
        if story.record is not None:
            path = story.record.raw
        if path and "raw" not in story.pictures and path not in self.files.problems:
            self.files.want(path, Rank.LARGE_PICTURE, lambda jpeg: story.keep("raw", jpeg))

    def _needs_record(self, story: CallStory, call: TrackedCall) -> bool:
        """Whether a call's record has something to tell: its pictures, and who was first."""
        pictured = "small" in story.pictures
        if story.record is None:
            failed = not call.data.picture or picture_path(story.id, "small") in self.files.problems
            wanted = call.open and call.data.kind is Kind.CALL and not call.data.test and (pictured or failed)
            return wanted or self._stories.others_were_first(call)
        if not story.first_answer(None) and self._stories.others_were_first(call):
            return True
        return call.open and pictured and not story.record.picture

    def _want_record(self, story: CallStory) -> None:
        def take(content: bytes) -> None:
            story.record = record = read_record(content)
            nearest = record.nearest
            if nearest is not None and nearest.picture and "nearest" not in story.pictures:
                there = self._stories.by_id.get(nearest.call_id or 0)
                if there is None or "small" not in there.pictures:
                    self.files.want(nearest.picture, Rank.RECORD, lambda jpeg: story.keep("nearest", jpeg))

        path = _record_path(story.id)
        if story.reads < MOST_READS and not self.files.waits(path):
            story.reads += 1
            self.files.want(path, Rank.RECORD, take)

    def _carries(self, rate: float) -> bool:
        return (self.files.rate or 0.0) >= rate

    def _want_state(self, rover: TrackedRover, now: float) -> None:
        missing = rover.current_id and not _is_open(rover.calls.get(rover.current_id))
        missing = missing or not self.words_are_known(rover)
        if self.state_wanted or not missing:
            self._state_pause = STATE_AGAIN_S
        wanted = self.state_wanted or missing
        if wanted and now - self._state_at >= self._state_pause and not self.files.waits(STATE_PATH):
            self._state_pause = min(2 * self._state_pause, STATE_LONGEST_S)
            self.state_wanted, self._state_at = False, now
            self.files.want(STATE_PATH, Rank.STATE, lambda content: self._take_state(content, rover, now))

    def _take_state(self, content: bytes, rover: TrackedRover, asked_at: float) -> None:
        state = read_state(content)
        if state.starting:
            return
        self._see_place(state.known_place)
        self.state = state
        self.words = dict(state.words)
        call = state.open_call
        known = None if call is None else rover.calls.get(call.id)
        if call is not None and call.id == rover.current_id and not _is_open(known):
            rover.handle_call(call, asked_at)
        if self._carries(QUICK_FOR_LARGE):
            if not self.checked:
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

    def _take_ground(self, png: bytes) -> None:
        if picture_size(png) is None:
            raise DocumentError("it is no picture")
        self.ground, self.grounds = png, self.grounds + 1

    def _want_earlier(self) -> None:
        """List the rover's calls, then fetch the records and small pictures of the newest."""
        self.earlier = "coming"
        self.files.want(CALLS_PATH, Rank.OLD, self._take_list)

    def _take_list(self, names: bytes) -> None:
        self.earlier = "known"
        listed = (_RECORD.fullmatch(name) for name in names.decode().splitlines())
        numbers = newest_first([int(found[1]) for found in listed if found])
        for number in numbers[:EARLIER]:
            if number not in self._stories.by_id:
                self.files.want(_record_path(number), Rank.OLD, self._take_record)

    def _take_record(self, content: bytes) -> None:
        record = read_record(content)
        story = self._stories.remember(record)
        if story is not None and record.picture:
            self.files.want(record.picture, Rank.OLD, lambda jpeg: story.keep("small", jpeg))
        self.named |= {word: weight for word, weight in named(record).items() if word not in self.named}

    def _take_checks(self, content: bytes) -> None:
        self.checks = read_checks(content)
        self.checked = True

    def note_named(self, words: Mapping[str, float]) -> None:
        """Take note of words that an operator gave as an answer."""
        for word, weight in words.items():
            self.named.pop(word, None)
            self.named[word] = weight
            if len(self.named) > MOST_NAMED:
                self.named.pop(next(iter(self.named)))

    def words_are_known(self, rover: TrackedRover) -> bool:
        """Whether `words` are all words in use."""
        if self.state is None:
            return False
        return rover.summary is None or rover.summary.words == words_hash(self.words)

    def pictures_of(self, number: int) -> dict[str, Any]:
        """Return how the pictures of a call come: why not, progress, or how long the large one would take."""
        path = picture_path(number, "large")
        small = picture_path(number, "small")
        problem = self.files.problems.get(small, "")
        coming = "Its picture is on its way." if self.files.waits(small) else ""
        return {
            "small_note": f"Its picture did not come: {problem}." if problem else coming,
            "large": {
                "waits": self.files.waits(path),
                "progress": self.files.progress(path),
                "seconds": None if not self.files.rate else round(LARGE_BYTES / self.files.rate),
                "problem": self.files.problems.get(path, ""),
            },
        }


def _record_path(number: int) -> str:
    return f"/calls/{number}.json"


def _is_open(call: TrackedCall | None) -> bool:
    return call is not None and call.data.stage is not Stage.CLOSED
