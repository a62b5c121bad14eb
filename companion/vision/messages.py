"""Defines the messages between supervisor and vision process: first the requests, then the reports."""

from __future__ import annotations

import logging
import sys
from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple

from msgspec import Meta, Struct

from anytraverse.answers import AnswerOutcome
from anytraverse.assessment import Assessment
from anytraverse.grid_map import GridMap
from anytraverse.history import Entry, History, Place
from anytraverse.judging import Settings
from anytraverse.memory import Memory
from anytraverse.operations import Operation
from anytraverse.perception import Perceiver, handles_infrared
from anytraverse.preferences import MAX_WORDS
from anytraverse.regions import Box
from anytraverse.roi import RoiFigures
from companion.cameras.newest import CameraStatus
from companion.config import Config
from companion.guide.plan import Errand, Plan
from companion.vehicle.motion import MotionReport
from companion.vision.freeze_detector import Luma
from companion.wire.ids import State
from companion.wire.packing import clean

LONGEST_TEXT = 4096
LARGEST_PNG = 32 << 20
"""Bytes of a frame as PNG, at most: a larger one would not fit beside others in channel and journal."""

LARGEST_JPEG = 4 << 20
"""Bytes of a recorded frame, at most."""

MOST_ROWS = 4
"""Remembered scenes in one report, at most. One with all words tapped takes 2 ms to decode and check."""

ROUNDING = 1e-6
"""By which a share may exceed its range."""

LARGEST_WHOLE = 1 << 53
"""Stamps and numbers count on from what is reported, and the journal takes no more than 63 bits."""

Text = Annotated[str, Meta(max_length=LONGEST_TEXT)]
Whole = Annotated[int, Meta(ge=0, le=LARGEST_WHOLE)]
Seconds = Annotated[float, Meta(ge=0.0, le=sys.float_info.max)]
Share = Annotated[float, Meta(ge=-ROUNDING, le=1.0 + ROUNDING)]
Rows = Annotated[tuple[Entry, ...], Meta(max_length=MOST_ROWS)]
Encoding = Annotated[bytes, Meta(max_length=LARGEST_JPEG)]


class _Report(Struct, frozen=True, array_like=True, tag=True, forbid_unknown_fields=True):
    """A message that is decoded by the types of its fields, and where they name a range, by that, too."""


class Model(NamedTuple):
    """Names the perceiver for a person.

    precision, why: the variant of the bundle that runs, and why that one; "" without a bundle.
    int8_idle: whether the bundle contains an int8 variant that does not run.
    infrared: whether its maps hold for a camera without infrared filter.
    """

    id: Text
    precision: Text = ""
    why: Text = ""
    int8_idle: bool = False
    infrared: bool = False

    @classmethod
    def of(cls, perceiver: Perceiver) -> Model:
        """Read the names from a perceiver."""
        precision = getattr(perceiver, "precision", "")
        manifest = getattr(perceiver, "manifest", None)
        idle = manifest is not None and "int8" in manifest.variants and precision != "int8"
        why = clean(getattr(perceiver, "why", ""))
        return cls(perceiver.model_id, precision, why, idle, handles_infrared(perceiver))

    def __str__(self) -> str:
        return f"{self.id}, {self.precision}: {self.why}" if self.precision else self.id


# Requests, to the vision process.


@dataclass(frozen=True)
class Start:
    """Opens the camera and loads the perceiver. It is the first message; no frame is judged before `Tune`.

    memory: the copy to start from, None: none was ever stored. revision: its number. first_frame: id of the
    first frame. more: number of remembered scenes that follow in `Scenes`, before any other message.
    """

    config: Config
    memory: Memory | None
    revision: int
    first_frame: int
    more: int = 0

    def joined(self, scenes: tuple[Entry, ...]) -> Start:
        """Return a copy that contains these scenes, too."""
        assert self.memory is not None
        history = History([*self.memory.history, *scenes], self.memory.history.limit)
        return replace(self, memory=replace(self.memory, history=history), more=self.more - len(scenes))


class Scenes(_Report, frozen=True):
    """Carries remembered scenes: those after a `Start`, or as a report rows of the next `MemoryUpdate`.

    Encoding or decoding all at once would stall the supervisor.
    """

    entries: Rows


@dataclass(frozen=True)
class Tune:
    """Judge frames by these settings from now on. No frame is judged before the first `Tune`."""

    number: int
    settings: Settings


@dataclass(frozen=True)
class Situation:
    """Says where the vehicle is, and how much to judge.

    rate: frames/s, None: as configured. motion: the newest report of how it leans and moves. reach: as in
    `Frame`. errand: what a way is planned for after each frame, None: none is.
    """

    place: Place
    rate: float | None = None
    motion: MotionReport | None = None
    reach: float | None = None
    errand: Errand | None = None


@dataclass(frozen=True)
class Apply:
    """Apply an answer; a `Done` of the same number follows.

    frame_id: of the stored frame of the call or hold, 0: words without a frame. place: the call's, None: the
    vehicle's. missing_ok, match: as of `AnyTraverse.answer`.
    """

    number: int
    operations: tuple[Operation, ...]
    frame_id: int
    call_id: int
    go: bool
    place: Place | None
    missing_ok: bool = False
    match: int | None = None


@dataclass(frozen=True)
class Restore:
    """Store and judge the frame of an open call or hold again; a `Done` of the same number follows."""

    number: int
    frame_id: int
    png: bytes


@dataclass(frozen=True)
class VideoMarks:
    """What a picture of the video shows beside the judgement.

    place: what a call is about. taps: what was tapped. note: what to do, at the foot.
    """

    place: Box | None = None
    taps: tuple[Box, ...] = ()
    note: str = ""


@dataclass(frozen=True)
class Draw:
    """Draw a recently judged frame; a `Drawn` of the same number follows.

    store: whether to store the frame, because it is a call's or hold's: answers and taps may refer to it from
    now on, and it is sent as PNG, too. video: how to draw it for the video; then nothing else is drawn.
    roi: the figures of the judgement that is meant: the frame may have been judged again since. None: the
    newest.
    """

    number: int
    frame_id: int
    title: str
    state: State
    store: bool
    video: VideoMarks | None = None
    roi: RoiFigures | None = None


@dataclass(frozen=True)
class Encode:
    """Encode a recently judged frame for the recording; an `Encoded` of the same number follows.

    It is done beside judging, at a lower priority, one frame at a time.
    """

    number: int
    frame_id: int


Request = Start | Scenes | Tune | Situation | Apply | Restore | Draw | Encode

# Reports, from the vision process.


class MemoryUpdate(_Report, frozen=True):
    """Changes the memory from revision `base` to `revision`: all of it but H, and the changed rows of H.

    memory: without the scenes of its history H. entries: new or changed rows of H, at most `MOST_ROWS`; more
    come before it in `Scenes`. removed: stamps (`Entry.order`) of the rows that went. weak: words in use that
    the perceiver recognises badly by name and that have no tap.
    """

    revision: Whole
    base: Whole
    memory: Memory
    entries: Rows
    removed: tuple[Whole, ...]
    weak: Annotated[tuple[Text, ...], Meta(max_length=MAX_WORDS)]


class Ready(_Report, frozen=True):
    """Reports that the perceiver is loaded and warmed up.

    settings: from the configuration and the perceiver's defaults. notices: texts about the memory for the
    operator. step: seconds of a whole step, the median.
    """

    model: Model
    settings: Settings
    update: MemoryUpdate
    notices: tuple[Text, ...]
    step: Annotated[float, Meta(ge=0.0, le=60.0)]


class Failed(_Report, frozen=True):
    """Reports that the perceiver cannot be loaded; the text says what to do."""

    text: Text


class Alive(_Report, frozen=True):
    """Shows a few times a second that the process is alive.

    delivered_at: monotonic seconds when the camera's newest frame came, None: none yet.
    """

    camera: CameraStatus
    delivered_at: float | None


class FrameJudged(_Report, frozen=True):
    """Reports a new frame's assessment.

    revision: of the memory by which it was judged. at: monotonic seconds when judging ended. duration:
    seconds of judging. sectors: drivable share of each image column over the ROI's rows, None where nothing
    is known. luma: the picture's, by which a frozen camera is found. update: the change of the memory by the
    frame itself, as the first reference or by a match. infrared: whether the camera shows infrared, None: not
    known yet. tuning: number of the `Tune` by whose settings it was judged, 0 before the first one.
    """

    assessment: Assessment
    revision: Whole
    at: float
    duration: Seconds
    sectors: Annotated[tuple[Share | None, ...], Meta(max_length=16)]
    luma: Luma
    update: MemoryUpdate | None = None
    infrared: bool | None = None
    tuning: Whole = 0


class Done(_Report, frozen=True):
    """Reports the outcome of an `Apply` or a `Restore`, or an error; then nothing has changed.

    tuning: as for `FrameJudged`.
    """

    number: Whole
    outcome: AnswerOutcome | None
    error: Text
    update: MemoryUpdate | None
    tuning: Whole = 0


class Drawn(_Report, frozen=True):
    """Carries pictures of a frame, b"" for each that could not be made or was not requested.

    panel: JPEG with maps and title, or the video's picture. thumbnail: JPEG for a radio. png: the frame
    itself. raw: the frame as JPEG without a mark, at most as wide as the panel. stored: whether the frame is
    stored, so that answers and taps may refer to it.
    """

    number: Whole
    frame_id: Whole
    title: Text
    panel: bytes = b""
    thumbnail: bytes = b""
    png: bytes = b""
    raw: bytes = b""
    stored: bool = False


class Encoded(_Report, frozen=True):
    """Carries a frame for the recording. picture is b"" for one that is left out, the maps where it has none.

    picture: JPEG of the frame as captured, at most `LARGEST_JPEG` bytes. traversability, uncertainty: its
    maps as grey PNG of 8 bits, at most 96 pixels wide: 0 is -1 in the signed map, 0 in the other, 255 is 1.
    """

    number: Whole
    frame_id: Whole
    picture: Encoding = b""
    traversability: Encoding = b""
    uncertainty: Encoding = b""


class GroundMap(_Report, frozen=True):
    """Carries what the local grid knows, once a second while the vehicle's pose is known."""

    content: GridMap


class Planned(_Report, frozen=True):
    """Carries the way that was planned when a frame's ground had been marked."""

    content: Plan


class Logged(_Report, frozen=True):
    """Carries a line for the supervisor's log, or several. level: as in `logging`."""

    level: Annotated[int, Meta(ge=0, le=logging.CRITICAL)]
    name: Text
    text: Text


Report = Ready | Failed | Alive | FrameJudged | Done | Drawn | Encoded | GroundMap | Planned | Logged | Scenes


def error_text(error: BaseException) -> str:
    """Return an error's text, or its class where that is empty: one line of at most `LONGEST_TEXT`."""
    return clean(str(error)[:LONGEST_TEXT]) or type(error).__name__
