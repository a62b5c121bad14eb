"""Decides whether hold can be given, and explains why not."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

from anytraverse.errors import SettingsError
from anytraverse.judging import Settings
from anytraverse.pace import Pace
from companion.config import Config
from companion.config.stopping import Stopping, ground_region, judge_stopping, with_settings
from companion.config.whole_check import unchecked
from companion.vision.infrared import REMEDY, TEXT
from companion.vision.warm_up import too_slow
from companion.wire import notices

GUIDES_FROM = 4.0
"""Judged pictures a second that policy guide needs. With fewer, on busy computers, the simulated rover has
touched things: picture, pose and order came apart."""
_ROUNDING = 1e-6


@dataclass(frozen=True)
class HoldRefusal:
    """Why hold cannot be given.

    why: the whole explanation with remedies, for the log. short: a STATUSTEXT that answers a request.
    reminder: a STATUSTEXT to repeat while hold is in force all the same, with what to do. reason: the cause
    alone, as a part of other STATUSTEXTs. fault: the same in two or three words.
    """

    why: str
    short: str
    reminder: str
    reason: str
    fault: str


class HoldConditions(NamedTuple):
    """What it depends on, beside the configuration, whether a vehicle may be held.

    judging: the settings in force. step: s that a frame takes to be judged. overrun: m, see `Autopilot`.
    speed: m/s that it drives, where that is more than configured. guides: the policy is guide.
    """

    judging: Settings
    step: float
    overrun: float = 0.0
    speed: float | None = None
    guides: bool = False
    misled_by_infrared: bool = False


class HoldGate:
    """Decides whether a vehicle with this configuration may be held."""

    def __init__(self, config: Config) -> None:
        self._config = config

    def stopping(self, now: HoldConditions) -> Stopping | str:
        """Judge whether the vehicle stops in time; a text where that is not possible."""
        policy = replace(self._config.call, policy="guide" if now.guides else "hold")
        config = replace(with_settings(self._config, now.judging, self.reach(now.speed)), call=policy)
        return judge_stopping(config, now.step, now.judging.thresholds.tile, now.speed, now.overrun)

    @property
    def configured_speed(self) -> float | None:
        """The commanded speed that is configured, m/s."""
        return self._config.stopping.speed

    def reach(self, speed: float | None) -> float | None:
        """Return `Frame.reach` at this speed, None where the region does not follow the speed."""
        if speed is None or self._config.roi.far is not None:
            return None
        try:
            ground = ground_region(self._config, speed)
        except SettingsError:  # a camera that looks aside sees too little of a longer region
            return None
        return None if ground is None else ground.far

    def refuses(self, now: HoldConditions) -> HoldRefusal | None:
        """Return why the vehicle may not be held, None where it may."""
        pace = Pace(now.step, 1.0 / self._config.camera.rate, now.judging.freshness)
        if not pace.keeps:
            return _too_slow(pace)
        if now.guides and pace.rate < GUIDES_FROM - _ROUNDING:
            return _too_slow_to_guide(pace.rate)
        outruns = self.outruns(now)
        return _infrared() if outruns is None and now.misled_by_infrared else outruns

    def outruns(self, now: HoldConditions) -> HoldRefusal | None:
        """Return why the vehicle does not stop in time, None where it does.

        What cannot be calculated is refused, unless [stopping] unchecked is set.
        """
        stopping = self.stopping(now)
        if isinstance(stopping, str):
            return None if self._config.stopping.unchecked else _unchecked(stopping)
        return None if stopping.enough else _outruns(stopping)


def _too_slow(pace: Pace) -> HoldRefusal:
    short, reminder = notices.hold_refused(pace.step), notices.fault_slow(pace.step)
    return HoldRefusal(too_slow(pace), short, reminder, "perceiver too slow for HOLD", "judges too slowly")


def _too_slow_to_guide(rate: float) -> HoldRefusal:
    short, reminder = notices.guide_slow(rate), notices.fault_guide_slow(rate)
    why = (
        f"guide cannot be given: {rate:.2g} pictures are judged a second, and it needs {GUIDES_FROM:g}: "
        "raise [camera] rate, use a smaller bundle or a faster computer, or set policy hold"
    )
    return HoldRefusal(why, short, reminder, "judges too seldom for GUIDE", "judges too seldom")


def _unchecked(missing: str) -> HoldRefusal:
    short, reminder = notices.hold_unchecked(), notices.fault_unchecked()
    return HoldRefusal(unchecked(missing), short, reminder, "stopping not checked", "stopping unchecked")


def _outruns(stopping: Stopping) -> HoldRefusal:
    speed, fits = stopping.speed, stopping.fits
    why = f"hold cannot be given: {stopping.describe()}"
    short, reminder = notices.hold_outruns(speed, fits), notices.fault_outruns(speed, fits)
    return HoldRefusal(why, short, reminder, notices.outruns(speed, fits), "too fast to stop")


def _infrared() -> HoldRefusal:
    why, reminder = f"hold cannot be given: {REMEDY}", notices.fault_infrared()
    return HoldRefusal(why, notices.hold_infrared(), reminder, TEXT, "NoIR camera")
