"""Implements `companion replay`: judges a drive again, and says what differs from before."""

from __future__ import annotations

import json
import re
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from companion.config import Config, ConfigError, load_config
from companion.drives.drive import DriveError
from companion.drives.frames import is_recording, located, open_drive
from companion.drives.judge import DriveJudge
from companion.drives.recorded import Recording
from companion.drives.replay import (
    Comparison,
    Row,
    compared,
    read_rows,
    replay_drive,
    replay_recording,
    write_rows,
)
from companion.vision.warm_up import load_engine

_ENDING = ".refs.jsonl"
_SECTION = re.compile(r"\[([a-z_]+)[].]")
_OF_THE_ROVER = frozenset({"web", "video", "link"})


def run(where: str, *, file: str | None, refs: str | None = None, update: bool = False) -> int:
    """Replay a drive. Returns 0 if it was judged as before, else 1.

    file: the configuration; None: that of the recording, else companion.toml. refs: the file of references,
    by default beside the drive. update: write it anew.
    Raises DriveError, ConfigError, AnyTraverseError, OSError.
    """
    path, began = located(where)[1], time.monotonic()
    references = Path(refs) if refs else path.with_name(path.name + _ENDING)
    if refs and not update and not references.exists():
        raise DriveError(f"{references} is not there: write it with --update-refs")
    known = None if update or not references.exists() else read_rows(references)
    against = f"by {references}" if known is not None else "as the rover judged them"
    if is_recording(path):
        rows, found = _recording(Recording(path), file, known)
    else:
        config = load_config(file or "companion.toml")
        drive = open_drive(where, config.camera.rate)
        if known is None and not update:
            raise DriveError(f"{references} is not there: write it with --update-refs")
        rows = list(replay_drive(DriveJudge(config, load_engine(config, None)[0]), drive))
        found = compared(rows, known or rows)
    if update and not rows:
        raise DriveError(f"{where} has no frame that can be judged again: no references are written")
    if update:
        print(f"{references}: {write_rows(references, rows)} references written")
        return 0
    print(f"{found.frames} frames are compared {against}; it took {time.monotonic() - began:.1f} s")
    for line in found.lines():
        print(line)
    print("the same" if found.same else "NOT the same" if found.frames else "nothing could be compared")
    print(json.dumps(found.figures()))
    return 0 if found.same else 1


def _recording(
    recording: Recording, file: str | None, known: Sequence[Row] | None
) -> tuple[list[Row], Comparison]:
    config = load_config(file) if file else config_of(recording)
    engine, _ = load_engine(config, None, misfit_allowed=True)
    if recording.model != engine.perceiver.model_id:
        print(f"recorded with {recording.model}, judged again with {engine.perceiver.model_id}")
    return replay_recording(engine, recording, known)


def config_of(recording: Recording) -> Config:
    """Load the configuration that was recorded."""
    if not recording.config:
        raise DriveError(f"{recording.title} has no configuration in it: name one with --config")
    with tempfile.TemporaryDirectory(prefix="replay-") as folder:
        file = Path(folder, "companion.toml")
        file.write_text(_about_judging(recording.config), encoding="utf-8")
        try:
            return load_config(file)
        except ConfigError as error:
            told = str(error).replace(str(file), "its companion.toml")
            raise DriveError(f"{recording.title}: {told}: name one with --config") from error


def _about_judging(config: str) -> str:
    """Leave out the sections that matter on the rover alone. Their secrets were not recorded."""
    kept, keeps = [], True
    for line in config.splitlines():
        if found := _SECTION.match(line):
            keeps = found[1] not in _OF_THE_ROVER
        if keeps:
            kept.append(line)
    return "\n".join([*kept, ""])
