"""Checks the live view."""

from __future__ import annotations

from companion.desk.check.page import served
from companion.desk.check.rover import CheckedRover
from companion.desk.check.rules import CheckFinding, Verdict, passed, warned
from companion.observers.live.live import missing

LIVE = "live view"


def check_live(rover: CheckedRover) -> list[CheckFinding]:
    """Check that the live view can be served, and say who may see it."""
    settings = rover.config.live
    if settings.address is None:
        return [passed(LIVE, 'off: [live] listen is ""')]
    if why := missing():
        return [warned(LIVE, f'{why}, or set [live] listen = ""')]
    loopback = settings.address.loopback
    whose = "to programs on this computer" if loopback else "to whoever reaches that port: it has no password"
    found = served(rover, LIVE, settings.listen, rover.told("live"), whose, "[live] listen")
    return [found if loopback or found.verdict is not Verdict.PASS else warned(LIVE, found.text)]
