"""Why the policy hold is refused: for the log, for whoever asks for it, and for whoever configured it."""

from __future__ import annotations

from dataclasses import dataclass

from anytraverse.pace import Pace
from companion.check.stopping import Stopping
from companion.readiness import too_slow
from companion.wire import notices


@dataclass(frozen=True)
class Refusal:
    """why: all of it, with remedies. short, reminder: STATUSTEXTs."""

    why: str
    short: str
    reminder: str


def hold_refusal(pace: Pace, stopping: Stopping | str) -> Refusal | None:
    """None where the vehicle may be held. stopping: as judged, or why not, which refuses nothing."""
    if not pace.keeps:
        return Refusal(too_slow(pace), notices.hold_refused(pace.step), notices.only_reports(pace.step))
    if isinstance(stopping, Stopping) and not stopping.enough:
        speed, fits = stopping.speed, stopping.fits
        why = f"policy hold is refused: {stopping.told()}"
        return Refusal(why, notices.hold_outruns(speed, fits), notices.only_reports_outrunning(speed, fits))
    return None
