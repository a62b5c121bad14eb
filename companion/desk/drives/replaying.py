"""Implements `companion replay`: judges a drive again, and says what differs from before."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from pathlib import Path

from anytraverse.perception import NAMED
from companion.config import Config, ConfigError, load_config, recorded_config
from companion.desk.drives.drive import DriveError, printable
from companion.desk.drives.frames import is_recording, located, open_drive
from companion.desk.drives.judge import DriveJudge, JudgementRow
from companion.desk.drives.recorded import RecordedDrive
from companion.desk.drives.replay import (
    ReplayComparison,
    compared,
    read_rows,
    replay_drive,
    replay_recording,
    write_rows,
)
from companion.vision.warm_up import load_engine

_ENDING = ".refs.jsonl"


def run(
    where: str,
    *,
    file: str | None,
    default: str = "companion.toml",
    refs: str | None = None,
    update: bool = False,
) -> int:
    """Replay a drive. Returns 0 if it was judged as before, else 1.

    file: the configuration; None: that of the recording, else `default`. refs: the file of references,
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
        rows, found = _recording(RecordedDrive(path), file, known)
    else:
        config = load_config(file or default)
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
    recording: RecordedDrive, file: str | None, known: Sequence[JudgementRow] | None
) -> tuple[list[JudgementRow], ReplayComparison]:
    config = load_config(file) if file else config_of(recording)
    engine, _ = load_engine(config, None, misfit_allowed=True)
    if recording.model != engine.perceiver.model_id:
        print(f"recorded with {recording.model}, judged again with {engine.perceiver.model_id}")
    return replay_recording(engine, recording, known)


def config_of(recording: RecordedDrive) -> Config:
    """Load the configuration that was recorded. Raises DriveError where it cannot be used here.

    A perceiver that lies in a file or folder of the rover is not looked for: another one may lie there.
    """
    if not recording.config:
        raise DriveError(f"{recording.title} has no configuration in it: name one with --config")
    try:
        config = recorded_config(recording.config)
    except ConfigError as error:
        raise DriveError(f"{recording.title}: {error}: name one with --config") from error
    if config.perceiver.name not in NAMED:
        judge = printable(config.perceiver.name)
        raise DriveError(
            f"{recording.title} was judged by {judge} of its rover: name one with it by --config"
        )
    return config
