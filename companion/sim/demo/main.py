"""Runs `companion demo`: with the simulated field, or on your own camera with --camera."""

from __future__ import annotations

import argparse
import errno
import json
import shutil
import signal
import sys
import tempfile
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from anytraverse.errors import AnyTraverseError
from companion.cameras import CameraError
from companion.sim.demo.child import ChildError, LoggedProcess
from companion.sim.demo.config import write_config, written_by_demo
from companion.sim.demo.director import ACROSS, Director, Stage, summary, verdict
from companion.sim.demo.operator import start_operator
from companion.sim.demo.sheet import write_sheet
from companion.sim.demo.story import Story
from companion.sim.field.control import FieldControl, FieldError

SPEED = 1.5
"""m/s that the simulated rover drives."""


class DemoPace(NamedTuple):
    """Frames/s that are judged, and m/s that the rover drives with so many."""

    rate: float
    speed: float


PACES = (DemoPace(10.0, SPEED), DemoPace(4.0, SPEED), DemoPace(1.5, 1.1))
"""The next one is tried where this computer judges too slowly for policy hold. With 1.5 frames/s the
freshness limit is 2 s, and a thing is noticed later: 1.1 m/s still stop in time."""
GUIDED_PACES = (DemoPace(10.0, 1.2), DemoPace(4.0, 1.2))
_OLD = ("state", "logs", "contact-sheet.png")


def main(options: argparse.Namespace) -> int:
    """Runs the demo. Exit code: 0 when it showed all that it should, 1 if not, 2 if `out` is not usable."""
    out = Path(options.out).absolute() if options.out else Path(tempfile.mkdtemp(prefix="atd-"))
    try:
        _make_room(out)
    except OSError as error:
        print(f"companion demo: {out}: {(error.strerror or str(error)).lower()}", file=sys.stderr)
        return 2
    story = Story(clock=not options.auto)
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, _end)
    try:
        if options.camera:
            from companion.sim.demo.rehearsal import run_camera_demo

            return run_camera_demo(options.camera, out, story, auto=options.auto)
        return _play(options, out, story)
    except (ChildError, FieldError, CameraError, AnyTraverseError) as error:
        print(f"companion demo: {error}", file=sys.stderr)
        return 1


def _make_room(out: Path) -> None:
    """Makes `out` an empty folder: deletes only an earlier demo's files; OSError if it holds others."""
    out.mkdir(parents=True, exist_ok=True)
    config = out / "companion.toml"
    foreign = {path.name for path in out.iterdir()} - {config.name, *_OLD}
    if foreign or (config.exists() and not written_by_demo(config)):
        raise OSError(errno.ENOTEMPTY, "holds files that no demo wrote: give another folder")
    for name in _OLD:
        path = out / name
        shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)


def _end(number: int, _frame: object) -> None:
    raise SystemExit(128 + number)


def _play(options: argparse.Namespace, out: Path, story: Story) -> int:
    opening = _OPENING + (_GUIDED if options.guide else "")
    yours = _YOUR_PART_IN_A_BROWSER if options.console else _YOUR_PART
    story.plain(opening if options.auto else opening + yours)
    figures = _played(options, out, story)
    sheet = write_sheet(out)
    code = verdict(figures, story, guide=options.guide) if options.auto else 0
    if not options.auto:
        story.plain(summary(figures))
    if sheet is not None:
        story.plain(f"Contact sheet of the key frames: {sheet}")
    if options.auto:
        story.plain(json.dumps({**figures, "seed": options.seed, "contact_sheet": str(sheet or "")}))
    return code


def _played(options: argparse.Namespace, out: Path, story: Story) -> dict[str, Any]:
    """Plays at the first pace at which hold can be given, and returns the figures. Raises ChildError."""
    for pace, slower in pairwise((*(GUIDED_PACES if options.guide else PACES), None)):
        assert pace is not None
        stage = set_stage(
            out,
            options.seed,
            auto=options.auto,
            speed=pace.speed,
            console=options.console,
            rate=pace.rate,
            guide=options.guide,
        )
        try:
            speed = pace.speed / SPEED
            director = Director(stage, story, auto=options.auto, speed=speed, guide=options.guide)
            refused = director.wait_until_ready()
            if not refused:
                return director.play()
            if slower is None:
                raise stage.daemon.error(f"cannot hold ({refused})")
        finally:
            stage.close()
        story.plain(f"{refused}: it judges {slower.rate:g} frames/s and drives {slower.speed:g} m/s")
        _make_room(out)
    raise AssertionError("unreachable")


def set_stage(
    out: Path,
    seed: int,
    *,
    auto: bool,
    speed: float = SPEED,
    console: bool = False,
    rate: float = PACES[0].rate,
    guide: bool = False,
) -> Stage:
    """Starts field, daemon and operator. speed: m/s that the rover drives. Raises ChildError.

    console: the operator has a browser, and the link is a network's. rate: frames/s that are judged. guide:
    the path is wide, a log lies across it, and the policy is guide.
    """
    logs = out / "logs"
    logs.mkdir(exist_ok=True)
    started: list[LoggedProcess] = []

    def track(child: LoggedProcess) -> LoggedProcess:
        started.append(child)
        return child

    wide = ["--half-width", "2.4", "--across", str(ACROSS)] if guide else []
    try:
        field = track(
            LoggedProcess(
                "field",
                ["companion.sim.field", "--seed", str(seed), "--speed", str(speed), *wide],
                logs / "field.log",
            )
        )
        ports = json.loads(field.first_line(20.0))
        if ports["script"] != "running":
            print(f"The script that stops the rover when the daemon is dead is {ports['script']}")
        camera, link = f"field:{ports['frames']}", ports["companion"]
        config = write_config(
            out,
            camera=camera,
            link=link,
            policy="guide" if guide else "hold",
            speed=speed,
            network=console,
            rate=rate,
            guide=guide,
        )
        daemon = track(LoggedProcess("daemon", ["companion", "run", str(config)], logs / "daemon.log"))
        operator = track(start_operator(ports["gcs"], logs, auto=auto, console=console))
        host, _, port = ports["control"].rpartition(":")
        return Stage(out, field, daemon, operator, FieldControl(host, int(port)))
    except BaseException:
        for child in reversed(started):
            child.stop()
        raise


_OPENING = """\
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
