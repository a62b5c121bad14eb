"""Defines the decisions of the state machine. The daemon executes and reports them."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from anytraverse.assessment import Assessment, Reason
from anytraverse.history import Place
from companion.calls.faults import FaultAcceptance
from companion.calls.hold import Hold, HoldEvent
from companion.calls.thing import Thing
from companion.wire.ids import Outcome


class CallState(Enum):
    """What an open call has been answered."""

    OPEN = "open"
    """Nothing that decides, or a go that was revoked."""
    NOT_COVERED = "not covered"
    """Words that do not cover the call's reasons."""
    ANSWERED = "answered"
    """Words that cover the call's reasons."""
    ACCEPTED = "accepted"
    """A go without words, with words above 0, or with any words once the reasons were gone."""


@dataclass
class Call:
    """A call to the operator for words.

    seen: the assessment of the call's frame, which is fixed when the call opens. None after a restart, until
    that frame is judged again.
    reasons: all reasons of the call, including later ones.
    thing: what is asked about. It is tracked while the call is open.
    learnt: an answer entered the call's scene in the history. quiet: "stay" ended the escalation of the text.
    gone_since: since when there are no reasons, monotonic seconds; None while there are.
    worst: highest mean uncertainty of the ROI while the call is open. worst_frame_id: the frame that had it.
    place: where the vehicle was, and when, as the call opened.
    """

    id: int
    frame_id: int
    reasons: set[Reason]
    opened_at: float
    seen: Assessment | None
    thing: Thing | None = None
    state: CallState = CallState.OPEN
    learnt: bool = False
    quiet: bool = False
    gone_since: float | None = None
    outcome: Outcome = Outcome.NONE
    worst: float = 0.0
    worst_frame_id: int = 0
    place: Place = field(default_factory=Place)

    def add(self, seen: Assessment) -> None:
        """Record a further frame's uncertainty, where it is the highest so far."""
        if seen.roi is not None and seen.roi.uncertainty > self.worst:
            self.worst, self.worst_frame_id = seen.roi.uncertainty, seen.frame.id

    @property
    def answered(self) -> bool:
        """Whether the call needs no further answer."""
        return self.state in _OUTCOMES

    @property
    def outcome_now(self) -> Outcome:
        """The outcome if the call were closed now, since its reasons are gone or its hold has ended."""
        return _OUTCOMES.get(self.state, Outcome.PASSED)


_OUTCOMES = {CallState.ANSWERED: Outcome.ANSWERED, CallState.ACCEPTED: Outcome.ACCEPTED}


@dataclass(frozen=True)
class SetMode:
    """Command the autopilot to change to a custom_mode.

    expected: the mode that this was decided on; if it shows another one, a human has set it. None: any.
    hold: the hold that begins or ends, by `Hold.commanded_as`; 0 for none.
    """

    mode: int
    expected: int | None = None
    hold: int = 0


@dataclass(frozen=True)
class ResumeCancelled:
    """A resume is not wanted any more: drop the command where it has not left yet. id: of the hold."""

    id: int


@dataclass(frozen=True)
class CallOpened:
    """A call opened: announce it, and store its frame."""

    call: Call


@dataclass(frozen=True)
class CallClosed:
    """A call closed: it needs no answer any more. `call.outcome` says why."""

    call: Call


class Unasked(Enum):
    """Why the autopilot drives by itself although nobody wants that."""

    REBOOTED = "rebooted into driving"
    """It rebooted, and nobody has set its mode since."""
    OVERRODE = "our late resume replaced a human's mode"


@dataclass(frozen=True)
class HoldStarted:
    """A hold started, for these reasons, or since the vehicle drove without anybody's will."""

    hold: Hold
    reasons: frozenset[Reason]
    unasked: Unasked | None = None


@dataclass(frozen=True)
class HoldMoved:
    """Something happened to the hold, see `HoldEvent`."""

    hold: Hold
    event: HoldEvent
    resuming: bool = False
    """For FAILED: the autopilot did not follow the command to resume, and still holds."""


@dataclass(frozen=True)
class HoldShown:
    """A hold without a call has its first blocked frame. Publish its picture: the operator may tap in it."""

    hold: Hold
    seen: Assessment


@dataclass(frozen=True)
class HoldRenamed:
    """A call opened during a hold, which takes the call's id. The id `old` is not used any more."""

    old: int
    hold: Hold


@dataclass(frozen=True)
class GoLapsed:
    """A go expired before it could be fulfilled: the operator must give it again."""

    id: int


@dataclass(frozen=True)
class FaultAccepted:
    """A human's mode over a hold accepted the faults that stood, within the limits of `acceptance`.

    acceptance: None where faults were accepted too often of late: the fault holds again. id: of the hold.
    """

    id: int
    acceptance: FaultAcceptance | None


@dataclass(frozen=True)
class FaultAcceptanceEnds:
    """An acceptance of faults is about to end. seconds, metres: what is left, metres None where not known."""

    seconds: float
    metres: float | None


@dataclass(frozen=True)
class WouldHold:
    """Shadow policy: a hold would have started now. `number` counts would-be holds from 1."""

    reasons: frozenset[Reason]
    number: int


@dataclass(frozen=True)
class WouldResume:
    """Shadow policy: the would-be hold ended, `lasted` seconds after it began.

    by_hand: a human or a change of policy ended it, not OK frames.
    """

    reasons: frozenset[Reason]
    number: int
    lasted: float
    by_hand: bool


Decision = (
    SetMode
    | ResumeCancelled
    | CallOpened
    | CallClosed
    | HoldStarted
    | HoldMoved
    | HoldShown
    | HoldRenamed
    | GoLapsed
    | FaultAccepted
    | FaultAcceptanceEnds
    | WouldHold
    | WouldResume
)
