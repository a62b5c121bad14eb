"""Checks the page for a browser."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from companion.desk.check.rover import CheckedRover
from companion.desk.check.rules import CheckFinding, passed, skipped, warned
from companion.observers.page.page import missing
from companion.pages.listen import read_listen

PAGE = "page"


def check_page(rover: CheckedRover) -> list[CheckFinding]:
    """Check that the page can be shown, and say who may see it."""
    if rover.config.web.address is None:
        return [passed(PAGE, 'off: [web] listen is ""')]
    if why := missing():
        return [warned(PAGE, f'{why}, or set [web] listen = ""')]
    whose = (
        "whoever knows the token, who may answer calls on it"
        if rover.config.web.token
        else "programs on this computer"
    )
    return [served(rover, PAGE, rover.config.web.listen, rover.told("web"), f"to {whose}", "[web] listen")]


def served(
    rover: CheckedRover, name: str, where: str, told: Mapping[str, Any], whose: str, setting: str
) -> CheckFinding:
    """Check what is served at "address:port": by the companion that runs, or that the port is free for it.

    told: what the companion that runs says of it. whose: to whom it is shown. setting: where to mend it.
    """
    if rover.running is not None:
        if told.get("trouble") == "starting":
            return skipped(name, "not known yet: it is starting")
        if told.get("trouble"):
            return warned(name, f"it {told['trouble']}, and is tried again: see {setting}, and the log")
        if not told.get("url"):
            return skipped(name, "not known: the companion that runs does not say where it is")
        return passed(name, f"{told['url']} shows it {whose}")
    try:
        listen = read_listen(where)
        assert listen is not None
        listen.bind().close()
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        return warned(name, f"{where} cannot be had ({why}): set another {setting}")
    return passed(name, f"{where} is free, and will show it {whose}")
