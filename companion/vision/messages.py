"""What supervisor and vision process say to each other: one table of messages for each direction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

from anytraverse.answers import AnswerOutcome, Changes
from anytraverse.assessment import Assessment
from anytraverse.history import Entry, History, Place
from anytraverse.judging import Settings
from anytraverse.memory import Memory
from anytraverse.perception import Perceiver
from companion.cameras.newest import CameraStatus
from companion.config import Config
from companion.wire.ids import State


class Model(NamedTuple):
    """A perceiver as a person knows it.

    precision, why: the variant of its bundle that runs, and why that one; "" without a bundle.
    int8_idle: the bundle carries int8, and it is not what runs.
    """

    id: str
    precision: str = ""
    why: str = ""
    int8_idle: bool = False

    @classmethod
    def of(cls, perceiver: Perceiver) -> Model:
        """What `perceiver` says of itself."""
        precision = getattr(perceiver, "precision", "")
        manifest = getattr(perceiver, "manifest", None)
        idle = manifest is not None and "int8" in manifest.variants and precision != "int8"
        return cls(perceiver.model_id, precision, getattr(perceiver, "why", ""), idle)

    def __str__(self) -> str:
        return f"{self.id}, {self.precision}: {self.why}" if self.precision else self.id


LONGEST_TEXT = 4096
LARGEST_PNG = 32 << 20
"""Bytes of a frame without loss: a larger one would leave neither channel nor journal enough room."""

# To the vision process.


@dataclass(frozen=True)
class Start:
    """The first message. The camera is opened and the perceiver loaded; nothing is judged before `Tune`.

    memory: the copy to work on, None: none was ever kept. revision: its number. first_frame: id of the first
    frame. more: remembered scenes that follow in `Scenes`, before anything else.
    """

    config: Config
    memory: Memory | None
    revision: int
    first_frame: int
    more: int = 0

    def joined(self, scenes: tuple[Entry, ...]) -> Start:
        """With scenes that followed."""
        assert self.memory is not None
        history = History([*self.memory.history, *scenes], self.memory.history.limit)
        return replace(self, memory=replace(self.memory, history=history), more=self.more - len(scenes))


@dataclass(frozen=True)
class Scenes:
    """More of the memory's remembered scenes: all at once would keep the supervisor for too long."""

    entries: tuple[Entry, ...]


@dataclass(frozen=True)
class Tune:
    """Judge by these settings from the next frame on; the first one lets the judging begin."""

    settings: Settings


@dataclass(frozen=True)
class Situation:
    """What the vehicle does now. moving: whether no picture can be the same as the one before."""

    place: Place
    moving: bool


@dataclass(frozen=True)
class Answer:
    """Apply an answer; a `Done` of the same number follows.

    frame_id: of the call's or hold's frame that was kept, 0: words without a frame. place: the call's, None:
    the vehicle's.
    """

    number: int
    changes: Changes
    frame_id: int
    call_id: int
    go: bool
    place: Place | None


@dataclass(frozen=True)
class Restore:
    """Take back the frame of an open call or hold; a `Done` of the same number follows. png: without loss."""

    number: int
    frame_id: int
    png: bytes


@dataclass(frozen=True)
class Draw:
    """Draw a frame that was judged lately; a `Drawn` of the same number follows.

    keep: it is a call's or hold's: it can be answered and tapped in from now on, and comes as PNG, too.
    """

    number: int
    frame_id: int
    title: str
    state: State
    keep: bool


Request = Start | Scenes | Tune | Situation | Answer | Restore | Draw

# From the vision process.


@dataclass(frozen=True)
class MemoryUpdate:
    """How the memory of `revision` differs from that of `base`: all but H, and the changed rows of H.

    entries: those of H that are new or changed. removed: stamps of those that went. weak: the words in use
    that the perceiver finds badly by name and that no tap explains.
    """

    revision: int
    base: int
    memory: Memory
    limit: int
    entries: tuple[Entry, ...]
    removed: tuple[int, ...]
    weak: tuple[str, ...]


@dataclass(frozen=True)
class Ready:
    """The perceiver is loaded and warmed up.

    settings: as the configuration and the perceiver have it. notices: what a person should be told of the
    memory. step: seconds of a whole step, the median.
    """

    model: Model
    settings: Settings
    update: MemoryUpdate
    notices: tuple[str, ...]
    step: float


@dataclass(frozen=True)
class Failed:
    """The perceiver cannot be made; the text tells what to do."""

    text: str


@dataclass(frozen=True)
class Alive:
    """Sent a few times a second. delivered_at: monotonic seconds of the newest frame, None: none yet."""

    camera: CameraStatus
    delivered_at: float | None


@dataclass(frozen=True)
class Looked:
    """A new frame was judged.

    revision: of the memory that it was judged under. at: monotonic seconds when it was done; took: seconds.
    sectors: drivable share of each image column over the ROI's rows, None where nothing is known.
    update: the memory that the frame itself changed, as the first reference or a match.
    """

    assessment: Assessment
    revision: int
    at: float
    took: float
    sectors: tuple[float | None, ...]
    update: MemoryUpdate | None = None


@dataclass(frozen=True)
class Done:
    """What became of an `Answer` or a `Restore`: an outcome, or an error; then nothing has changed."""

    number: int
    outcome: AnswerOutcome | None
    error: str
    update: MemoryUpdate | None


@dataclass(frozen=True)
class Drawn:
    """Pictures of a frame, b"" for what could not be made or was not asked for.

    panel: JPEG with maps and title. thumbnail: JPEG for a radio. png: the frame itself, without loss.
    kept: it was to be kept, and can be answered and tapped in from now on.
    """

    number: int
    frame_id: int
    title: str
    panel: bytes = b""
    thumbnail: bytes = b""
    png: bytes = b""
    kept: bool = False


@dataclass(frozen=True)
class Logged:
    """A line for the supervisor's log. level: as of `logging`."""

    level: int
    name: str
    text: str


Report = Ready | Failed | Alive | Looked | Done | Drawn | Logged


def told(error: BaseException) -> str:
    """What an error says, never nothing, and no more than is believed."""
    return (str(error) or type(error).__name__)[:LONGEST_TEXT]


def update_from(
    base: Memory | None, memory: Memory, revision: int, base_revision: int, weak: tuple[str, ...]
) -> MemoryUpdate:
    """What makes `memory` of `base`; None: everything."""
    before: Mapping[int, Entry] = {} if base is None else {entry.order: entry for entry in base.history}
    after = {entry.order: entry for entry in memory.history}
    return MemoryUpdate(
        revision=revision,
        base=base_revision,
        memory=replace(memory, history=History()),
        limit=memory.history.limit,
        entries=tuple(entry for stamp, entry in after.items() if before.get(stamp) is not entry),
        removed=tuple(stamp for stamp in before if stamp not in after),
        weak=weak,
    )


def updated(base: Memory | None, update: MemoryUpdate) -> Memory:
    """The memory after `update`; what did not change is the same object as in `base`."""
    entries = {} if base is None else {entry.order: entry for entry in base.history}
    for stamp in update.removed:
        entries.pop(stamp, None)
    entries.update((entry.order, entry) for entry in update.entries)
    return replace(update.memory, history=History(list(entries.values()), update.limit))
