"""Why the policy hold is refused: for the log, for whoever asks for it, and for whoever configured it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from anytraverse.errors import AnyTraverseError
from anytraverse.judging import Settings
from anytraverse.pace import Pace
from companion.config import Config
from companion.policy.stopping import Stopping, judge
from companion.vision.warm_up import too_slow
from companion.wire import notices


@dataclass(frozen=True)
class HoldRefusal:
    """why: all of it, with remedies. short, reminder: STATUSTEXTs. reason: what these say, alone."""

    why: str
    short: str
    reminder: str
    reason: str


class UncheckedError(AnyTraverseError):
    """Policy hold is configured, and nobody can say whether the vehicle stops in time."""


def require_checkable(config: Config) -> None:
    """Raises UncheckedError where the policy is hold and the stopping distance cannot be reckoned."""
    stopping = judge(config)
    if config.call.policy == "hold" and isinstance(stopping, str) and not config.stopping.unchecked:
        raise UncheckedError(unchecked(stopping))


def unchecked(missing: str) -> str:
    """Why policy hold is refused, and what to do. missing: as `judge` says it."""
    return (
        f"policy hold is refused, since nobody can say whether the vehicle stops in time: {missing}. "
        "Or drive without that knowledge: set [stopping] unchecked = true"
    )


Refuses = Callable[[Settings, float], HoldRefusal | None]
"""Judges whether the vehicle may be held with these settings, and an autopilot with this overrun in m."""


class HoldGate:
    """Whether a vehicle so configured may be held. pace: how fast its frames are judged."""

    def __init__(self, config: Config, pace: Pace) -> None:
        self._config = config
        self._pace = pace

    def stopping(self, judging: Settings, overrun: float = 0.0) -> Stopping | str:
        """Whether it stops before what it sees, with the settings now in force; or why nobody knows."""
        bounds = judging.region.bounds
        roi = replace(
            self._config.roi,
            left=bounds.left,
            top=bounds.top,
            right=bounds.right,
            bottom=bounds.bottom,
            tile_share=judging.tile_share,
        )
        config = replace(self._config, roi=roi)
        return judge(config, self._pace.step, judging.thresholds.tile, overrun=overrun)

    def refuses(self, judging: Settings, overrun: float = 0.0) -> HoldRefusal | None:
        """None where it may be held. What cannot be judged is refused, but where its owner wants that."""
        stopping = self.stopping(judging, overrun)
        if isinstance(stopping, str) and self._config.stopping.unchecked:
            return hold_refusal(self._pace, None)
        return hold_refusal(self._pace, stopping)


def hold_refusal(pace: Pace, stopping: Stopping | str | None) -> HoldRefusal | None:
    """None where the vehicle may be held. stopping: as judged, or why not; None: that is no matter."""
    if not pace.keeps:
        short, reminder = notices.hold_refused(pace.step), notices.only_reports(pace.step)
        return HoldRefusal(too_slow(pace), short, reminder, "perceiver too slow for HOLD")
    if isinstance(stopping, str):
        short, reminder = notices.hold_unchecked(), notices.only_reports_unchecked()
        return HoldRefusal(unchecked(stopping), short, reminder, "stopping not checked")
    if stopping is not None and not stopping.enough:
        speed, fits = stopping.speed, stopping.fits
        why = f"policy hold is refused: {stopping.told()}"
        short, reminder = notices.hold_outruns(speed, fits), notices.only_reports_outrunning(speed, fits)
        return HoldRefusal(why, short, reminder, notices.outruns(speed, fits))
    return None
