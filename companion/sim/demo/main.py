"""Runs `companion demo`: with the simulated field, or on your own camera with --camera."""

from __future__ import annotations

import argparse
import errno
import json
import shutil
import signal
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from anytraverse.errors import AnyTraverseError
from companion.cameras import CameraError
from companion.sim.demo.animation import AnimationError, Moment
from companion.sim.demo.child import ChildError
from companion.sim.demo.config import written_by_demo
from companion.sim.demo.director import Director
from companion.sim.demo.sheet import write_sheet
from companion.sim.demo.stage import set_stage
from companion.sim.demo.story import Story
from companion.sim.demo.verdict import about_the_computer, summary, verdict
from companion.sim.field.control import FieldError

_OLD = ("state", "logs", "contact-sheet.png")


def main(options: argparse.Namespace, story: Story) -> int:
    """Runs the demo. Exit code: 0 when it showed all that it should, 1 if not, 2 if `out` is not usable."""
    out = Path(options.out).absolute() if options.out else Path(tempfile.mkdtemp(prefix="atd-"))
    try:
        _make_room(out)
    except OSError as error:
        print(f"companion demo: {out}: {(error.strerror or str(error)).lower()}", file=sys.stderr)
        return 2
    story.doing = "the simulated field starts"
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, _end)
    try:
        if options.camera:
            from companion.sim.demo.rehearsal import run_camera_demo

            story.doing = "the camera's pictures are judged" if options.auto else ""
            return run_camera_demo(options.camera, out, story, auto=options.auto)
        return _play(options, out, story)
    except (AnimationError, ChildError, FieldError, CameraError, AnyTraverseError, OSError) as error:
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
    stage = set_stage(
        out,
        options.seed,
        auto=options.auto,
        console=options.console,
        guide=options.guide,
        record=bool(options.animation),
    )
    try:
        director = Director(stage, story, auto=options.auto)
        figures = director.play()
    finally:
        story.doing = "field, daemon and operator end"
        stage.close()
    story.doing = "the contact sheet is drawn"
    sheet = write_sheet(out)
    story.plain()
    story.plain(about_the_computer(figures))
    code = verdict(figures, story, guide=options.guide) if options.auto else 0
    if not options.auto:
        story.plain(summary(figures))
    if sheet is not None:
        story.plain(f"Contact sheet of the key frames: {sheet}")
    if options.animation:
        story.doing = "the animation is drawn"
        story.plain(_animated(Path(options.animation), out, director.moments))
    if options.auto:
        story.plain(json.dumps({**figures, "seed": options.seed, "contact_sheet": str(sheet or "")}))
    return code


def _animated(file: Path, out: Path, moments: Sequence[Moment]) -> str:
    """Writes the animation, and says where it is. Raises AnimationError."""
    from companion.config import load_config
    from companion.config.stopping import region_of
    from companion.sim.demo.animation import animate

    region = region_of(load_config(str(out / "companion.toml")))
    size = animate(out / "state" / "recordings", moments, region, file)
    return f"Animation: {file}, {size / 1e6:.1f} MB"
