"""Decides whether the policy hold is allowed, and explains a refusal."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from anytraverse.errors import AnyTraverseError
from anytraverse.judging import Settings
from anytraverse.pace import Pace
from companion.config import Config
from companion.config.stopping import Stopping, judge_stopping, with_settings
from companion.vision.infrared import REMEDY, TEXT
from companion.vision.warm_up import too_slow
from companion.wire import notices


@dataclass(frozen=True)
class HoldRefusal:
    """Why the policy hold is refused.

    why: the whole explanation with remedies, for the log. short: a STATUSTEXT that answers a request.
    reminder: a STATUSTEXT to repeat. reason: the cause alone, as a part of other STATUSTEXTs.
    """

    why: str
    short: str
    reminder: str
    reason: str


class UncheckedError(AnyTraverseError):
    """The policy hold is configured, but it cannot be calculated whether the vehicle stops in time."""


def require_checkable(config: Config) -> None:
    """Raise UncheckedError where the policy is hold and the stopping distance cannot be calculated."""
    stopping = judge_stopping(config)
    if config.call.policy == "hold" and isinstance(stopping, str) and not config.stopping.unchecked:
        raise UncheckedError(unchecked(stopping))


def unchecked(missing: str) -> str:
    """Return why the policy hold is refused, and what to do. missing: what `judge_stopping` returned."""
    return (
        f"policy hold is refused, since it is not known whether the vehicle stops in time: {missing}. "
        "Or allow hold without that check: set [stopping] unchecked = true"
    )


Refuses = Callable[[Settings, float, bool], HoldRefusal | None]
"""Decides whether the vehicle may be held: of the settings, the autopilot's overrun in metres, and whether
infrared misleads the perceiver."""


class HoldGate:
    """Decides whether a vehicle with this configuration may be held. pace: how fast its frames are judged."""

    def __init__(self, config: Config, pace: Pace) -> None:
        self._config = config
        self._pace = pace

    def stopping(self, judging: Settings, overrun: float = 0.0) -> Stopping | str:
        """Judge whether the vehicle stops in time with these settings; a text where that is not possible.

        overrun: metres, see `Autopilot`.
        """
        config = with_settings(self._config, judging)
        return judge_stopping(config, self._pace.step, judging.thresholds.tile, overrun=overrun)

    def refuses(
        self, judging: Settings, overrun: float = 0.0, misled_by_infrared: bool = False
    ) -> HoldRefusal | None:
        """Return why the vehicle may not be held, None where it may.

        What cannot be calculated is refused, unless [stopping] unchecked is set.
        """
        stopping = self.stopping(judging, overrun)
        unchecked = isinstance(stopping, str) and self._config.stopping.unchecked
        refusal = hold_refusal(self._pace, None if unchecked else stopping)
        return infrared_refusal() if refusal is None and misled_by_infrared else refusal


def hold_refusal(pace: Pace, stopping: Stopping | str | None) -> HoldRefusal | None:
    """Return why the vehicle may not be held, None where it may.

    stopping: the result of `judge_stopping`; None: the stopping distance does not matter.
    """
    if not pace.keeps:
        short, reminder = notices.hold_refused(pace.step), notices.only_reports(pace.step)
        return HoldRefusal(too_slow(pace), short, reminder, "perceiver too slow for HOLD")
    if isinstance(stopping, str):
        short, reminder = notices.hold_unchecked(), notices.only_reports_unchecked()
        return HoldRefusal(unchecked(stopping), short, reminder, "stopping not checked")
    if stopping is not None and not stopping.enough:
        speed, fits = stopping.speed, stopping.fits
        why = f"policy hold is refused: {stopping.describe()}"
        short, reminder = notices.hold_outruns(speed, fits), notices.only_reports_outrunning(speed, fits)
        return HoldRefusal(why, short, reminder, notices.outruns(speed, fits))
    return None


def infrared_refusal() -> HoldRefusal:
    """Return the refusal of policy hold for a camera whose infrared misleads the perceiver."""
    why = f"policy hold is refused: {REMEDY}"
    return HoldRefusal(why, notices.hold_infrared(), notices.only_reports_infrared(), TEXT)
