"""Says what the demo shows. It imports nothing heavy, so that it is read before the rest is loaded."""

from __future__ import annotations

import argparse

from companion.sim.demo.story import Story

_STORY = """\
A rover drives a trail by itself. The daemon on it looks ahead and judges the ground by words and weights:
grass and dirt path are drivable, bush, tree and sky are not. It was told of this meadow and of nothing else.
When a place or a thing has no word it holds the rover and calls the operator over MAVLink.
"""

_GUIDED = """
The path is wide here. What leaves room beside it, the daemon drives round by itself; further on a log lies
across the path, and leaves none.
"""

_YOUR_PART = """\
You are that operator. At a call look at the picture that it names, and type an answer, for example:

    tap drum -1 go                        what it points at is a drum: wait until it is gone, then drive on
    gravel: 1; dry grass: 0.3, go         words for a new place: drive on
    go                                    drive on, over the thing, this once

Lines with [brackets] are told by somebody beside the trail. `help` shows the rest, `quit` ends the demo.
"""

_YOUR_PART_IN_A_BROWSER = """\
You are that operator. The console opens in your browser, at the address below. At a call look at its picture:
what is in the yellow frame? Type its name and press Enter, or press Go. Ctrl-C here ends the demo.

Lines with [brackets] are told by somebody beside the trail.
"""

_STARTING = "Field, daemon and operator start."


def begin(options: argparse.Namespace) -> Story:
    """Print the first lines, and return the story, which goes on."""
    story = Story(clock=not options.auto)
    who = opening(auto=options.auto, console=options.console, guide=options.guide, camera=options.camera)
    story.plain(who)
    story.doing = "the programs are loaded"
    return story


def opening(*, auto: bool, console: bool, guide: bool, camera: str | None) -> str:
    """Return the first lines of a demo with these options."""
    if camera:
        return "The daemon and the operator's terminal start."
    yours = "" if auto else _YOUR_PART_IN_A_BROWSER if console else _YOUR_PART
    return f"{_STORY}{_GUIDED if guide else ''}{yours}\n{_STARTING}"
