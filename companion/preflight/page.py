"""Checks the page for a browser."""

from __future__ import annotations

from companion.preflight.rover import Rover
from companion.preflight.rules import Finding, passed, skipped, warned
from companion.web.page import EXTRA, missing

PAGE = "page"


def check_page(rover: Rover) -> list[Finding]:
    """Check that the page can be shown, and say who may see it."""
    listen = rover.config.web.address
    if listen is None:
        return [passed(PAGE, 'off: [web] listen is ""')]
    if packages := missing():
        return [warned(PAGE, f'{", ".join(packages)} not installed: {EXTRA}, or set [web] listen = ""')]
    whose = "whoever knows the token" if rover.config.web.token else "programs on this computer"
    if rover.running is not None:
        told = rover.told("web")
        if told.get("trouble") == "starting":
            return [skipped(PAGE, "not known yet: it is starting")]
        if told.get("trouble"):
            return [warned(PAGE, f"it {told['trouble']}, and is tried again: see [web] listen, and the log")]
        if not told.get("url"):
            return [skipped(PAGE, "not known: the companion that runs does not say where it is")]
        return [passed(PAGE, f"{told['url']} shows it to {whose}")]
    try:
        listen.bind().close()
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        return [warned(PAGE, f"{rover.config.web.listen} cannot be had ({why}): set another [web] listen")]
    return [passed(PAGE, f"{rover.config.web.listen} is free, and will show it to {whose}")]
