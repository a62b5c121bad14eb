"""`companion demo`: with the simulated field, or on a camera of your own with --camera."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
from pathlib import Path

from companion.demo.child import Child, ChildError
from companion.demo.config import write_config
from companion.demo.director import Director, Stage, verdict
from companion.demo.sheet import write_sheet
from companion.demo.story import Story
from companion.field.control import FieldControl, FieldError


def main(options: argparse.Namespace) -> int:
    """Run the demo; the exit code is 0 only if all that it should show was shown."""
    out = Path(options.out).absolute() if options.out else Path(tempfile.mkdtemp(prefix="atd-"))
    for old in ("state", "contact-sheet.png"):
        path = out / old
        shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)
    out.mkdir(parents=True, exist_ok=True)
    story = Story()
    try:
        if options.camera:
            from companion.demo.rehearsal import rehearse

            return rehearse(options.camera, out, story, auto=options.auto)
        return _play(options, out, story)
    except (ChildError, FieldError) as error:
        print(f"companion demo: {error}", file=sys.stderr)
        return 1


def _play(options: argparse.Namespace, out: Path, story: Story) -> int:
    stage = set_stage(out, options.seed, auto=options.auto)
    try:
        story.plain(_OPENING)
        director = Director(stage, story, auto=options.auto)
        figures = director.play()
    finally:
        stage.close()
    sheet = write_sheet(out)
    code = verdict(figures, story) if options.auto else 0
    if sheet is not None:
        story.plain(f"Contact sheet of the key frames: {sheet}")
    story.plain(json.dumps({**figures, "seed": options.seed, "contact_sheet": str(sheet or "")}))
    return code


def set_stage(out: Path, seed: int, *, auto: bool) -> Stage:
    """Start field, daemon and operator. Raises ChildError."""
    logs = out / "logs"
    logs.mkdir(exist_ok=True)
    started: list[Child] = []

    def start(name: str, arguments: list[str], *, interactive: bool = False) -> Child:
        child = Child(name, arguments, logs / f"{name}.log", interactive=interactive)
        started.append(child)
        return child

    try:
        field = start("field", ["companion.field", "--seed", str(seed), "--speed", "2.5"])
        ports = json.loads(field.first_line(20.0))
        config = write_config(out, camera=f"field:{ports['frames']}", link=ports["companion"], policy="hold")
        daemon = start("daemon", ["companion", "run", "--config", str(config)])
        events = ["--events"] if auto else []
        arguments = ["gcs_plugin.terminal", "--connect", ports["gcs"], *events]
        operator = start("operator", arguments, interactive=not auto)
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
