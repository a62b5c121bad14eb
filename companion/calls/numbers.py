"""The numbers of the operator-call state machine: one table."""

from __future__ import annotations

from dataclasses import dataclass, field

from anytraverse.judging import Settings
from companion.wire.ids import Policy


@dataclass(frozen=True)
class Numbers:
    """Counts are frames, times seconds, distances metres, `accepted_rise` uncertainty in [0, 1]."""

    policy: Policy = Policy.REPORT
    judging: Settings = field(default_factory=Settings)

    votes: int = 2
    """A reason counts after this many bad frames ..."""
    window: int = 3
    """... of the last this many, and ends after as many clear ones."""
    ok_frames: int = 5
    """OK frames in a row before anything resumes, and before an accepted thing counts as gone."""
    passed_after: float = 5.0
    """In report policy a call whose reasons are gone this long is closed as passed."""
    accepted_for: float = 20.0
    """An acceptance ends after this time ..."""
    accepted_distance: float = 10.0
    """... or this distance, where it is known."""
    accepted_rise: float = 0.1
    """A mean uncertainty this far above the accepted one calls again."""
    go_lasts: float = 60.0
    """A go may be given at most this long before the last frame that was not OK."""
    announce_guard: float = 2.0
    """An answer to "the current one" counts only if that was announced at least this long ago."""
    mode_retry: float = 1.0
    """A mode change that the autopilot does not show is commanded again after this time ..."""
    mode_tries: int = 3
    """... this many times; then ALERT ..."""
    mode_retry_failed: float = 5.0
    """... and at this interval for as long as it is needed."""
    mode_settles: float = 3.0
    """The way back, called back by us, may show for this long without a human's doing."""
    vehicle_silence: float = 5.0
    """A mode last heard this long ago is not known any more: nothing is commanded over it."""
    heartbeat_lost: float = 3.0
    """Under hold an autopilot that was heard and is silent for this long is a fault ..."""
    heartbeat_back: float = 2.0
    """... until it has been heard for this long."""
    fault_ends_hold: bool = False
    """Whether the hold of a fault may end by itself."""
    px4_hold: str = "loiter"
    """How a PX4 rover is held: a name of `PX4_HOLDS`."""

    @property
    def freshness(self) -> float:
        """T: without an OK frame for this long the vehicle is held."""
        return self.judging.freshness
