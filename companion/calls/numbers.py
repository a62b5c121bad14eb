"""Defines the counts, times and distances of the operator-call state machine, with their defaults."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from anytraverse.assessment import Assessment
from anytraverse.judging import Settings


@dataclass
class Numbers:
    """The state machine's numbers, shared by its parts. Only `judging` changes, see `OperatorCalls.retune`.

    Counts are frames, times are seconds, distances are metres. `accepted_rise` is an uncertainty in [0, 1].
    """

    judging: Settings = field(default_factory=Settings)

    votes: int = 2
    """A reason starts after this many bad frames of the last `window`, and ends after as many clear ones."""
    window: int = 3
    """Frames that `votes` is counted over."""
    ok_frames: int = 5
    """OK frames in a row before a hold resumes, and clear frames before an accepted thing counts as gone."""
    passed_after: float = 5.0
    """A call without a hold is closed as passed when its reasons have been gone for this long."""
    accepted_for: float = 20.0
    """An acceptance ends after this time, that of a thing in view after twice the time."""
    accepted_distance: float = 10.0
    """An acceptance ends after this distance, where the position is known; as the time, twice in view."""
    accepted_rise: float = 0.1
    """A mean uncertainty of the ROI this far above the accepted one opens a new call."""
    go_lasts: float = 60.0
    """A go expires when a frame that is not OK comes later than this after it."""
    announce_guard: float = 2.0
    """An answer to "the current one" (id 0) counts only if that was announced at least this long ago.

    An earlier answer was probably meant for the one before.
    """
    mode_retry: float = 1.0
    """A mode that the autopilot does not show is commanded again after this time."""
    mode_tries: int = 3
    """After this many commands without success the operator gets a text of severity ALERT."""
    mode_retry_failed: float = 5.0
    """From then on the mode is commanded at this interval."""
    mode_settles: float = 3.0
    """For so long after a hold on setpoints is released, the command to hold may still be on its way."""
    vehicle_silence: float = 5.0
    """A mode that was reported longer ago than this is unknown, and nothing is commanded."""
    heartbeat_lost: float = 3.0
    """Under the hold policy it is a fault when an autopilot's heartbeats stop for this long."""
    heartbeat_back: float = 2.0
    """That fault ends when heartbeats have come again for this long."""
    fault_ends_hold: bool = False
    """Whether a hold that only a fault caused may end without a go."""
    px4_hold: str = "loiter"
    """How a PX4 rover is held: a name of `PX4_HOLDS`."""

    def at(self, seen: Assessment) -> Numbers:
        """Return these numbers with the region, corridor and tiles by which a frame was judged."""
        judging = self.judging.at(seen.frame.lean, seen.frame.reach)
        return self if judging is self.judging else replace(self, judging=judging)

    @property
    def freshness(self) -> float:
        """The freshness limit T, seconds: without an OK frame for this long the vehicle is held."""
        return self.judging.freshness
