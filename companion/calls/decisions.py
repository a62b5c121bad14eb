"""What the state machine decides: the daemon carries it out and tells people."""

from __future__ import annotations

from dataclasses import dataclass, field

from anytraverse.assessment import Assessment, Reason
from anytraverse.history import Place
from companion.calls.acceptance import Acceptance
from companion.calls.hold import Hold, HoldEvent
from companion.wire.ids import Outcome


@dataclass
class Call:
    """A call for words.

    seen: the frame of the call, fixed when it is announced; None after a restart until it is judged again.
    reasons: all that it was raised for, later ones included.
    scope: what a go without words would accept; it follows the thing while the call is open.
    tried: an answer did not cover it. answered: its answer covers it. accepted: by a go without words.
    learnt: its place is in the history.
    quiet: "stay" ended the escalation. gone_since: when its reasons were gone, None while they are there.
    worst: mean uncertainty of the ROI at its worst, worst_frame_id: and where.
    place: where the vehicle was, and when, as it was announced.
    """

    id: int
    frame_id: int
    reasons: set[Reason]
    opened_at: float
    seen: Assessment | None
    scope: Acceptance | None = None
    tried: bool = False
    answered: bool = False
    accepted: bool = False
    learnt: bool = False
    quiet: bool = False
    gone_since: float | None = None
    outcome: Outcome = Outcome.NONE
    worst: float = 0.0
    worst_frame_id: int = 0
    place: Place = field(default_factory=Place)

    def add(self, seen: Assessment) -> None:
        """Another frame while it is open: a worse one is added to the record."""
        if seen.roi is not None and seen.roi.uncertainty > self.worst:
            self.worst, self.worst_frame_id = seen.roi.uncertainty, seen.frame.id

    @property
    def answered_outcome(self) -> Outcome:
        """How it is closed once its answer is fulfilled."""
        return Outcome.ACCEPTED if self.accepted else Outcome.ANSWERED


@dataclass(frozen=True)
class SetMode:
    """Command the autopilot into a custom_mode."""

    mode: int


@dataclass(frozen=True)
class CallOpened:
    """A call to announce and to keep the frame of."""

    call: Call


@dataclass(frozen=True)
class CallClosed:
    """A call that needs no answer any more; its outcome says why."""

    call: Call


@dataclass(frozen=True)
class HoldStarted:
    """The vehicle is to stand."""

    hold: Hold
    reasons: frozenset[Reason]


@dataclass(frozen=True)
class HoldMoved:
    """The hold was confirmed, failed, taken over or resumed."""

    hold: Hold
    event: HoldEvent
    resuming: bool = False
    """For FAILED: it was the way back that failed."""


@dataclass(frozen=True)
class HoldShown:
    """A hold without a call has a frame that shows what blocks the way."""

    hold: Hold
    seen: Assessment


@dataclass(frozen=True)
class HoldRenamed:
    """A hold that goes on as part of a call: `old` names nothing any more."""

    old: int
    hold: Hold


@dataclass(frozen=True)
class GoLapsed:
    """A go waited for a clear view for too long: it must be given again."""

    id: int


@dataclass(frozen=True)
class WouldHold:
    """Shadow policy: a hold would have started now, the `number`-th."""

    reasons: frozenset[Reason]
    number: int


@dataclass(frozen=True)
class WouldResume:
    """Shadow policy: the would-be hold is over, `lasted` seconds after it began.

    by_hand: frames did not end it, but a human, or another policy.
    """

    reasons: frozenset[Reason]
    number: int
    lasted: float
    by_hand: bool


Decision = (
    SetMode
    | CallOpened
    | CallClosed
    | HoldStarted
    | HoldMoved
    | HoldShown
    | HoldRenamed
    | GoLapsed
    | WouldHold
    | WouldResume
)
