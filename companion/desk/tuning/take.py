"""Implements `companion tune --take`: writes a setting that somebody chose into the configuration."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from anytraverse.regular_file import read_regular
from companion.config import editing, load_config
from companion.desk.drives.drive import DriveError
from companion.desk.tuning.proposal import Candidate, differing, in_time
from companion.desk.tuning.trial import Combination
from companion.vision.warm_up import load_engine

_MOST_BYTES = 256_000_000


def take(number: int, *, source: str, file: str, write: bool) -> int:
    """Say what setting `number` changes in the configuration `file`, and write it where asked. Returns 0.

    source: a tuning.json of `companion tune`, or a calls.json of `anytraverse calls`.
    Raises DriveError for a setting that cannot be taken, ConfigError, AnyTraverseError, OSError.
    """
    told, row = _read(source, number)
    config = load_config(file)
    engine, _ = load_engine(config, None)
    if told.get("model") != engine.perceiver.model_id:
        raise DriveError(
            f"{source} is of {told.get('model')}, and {file} has {engine.perceiver.model_id}: its thresholds "
            "are others, so run the command anew"
        )
    chosen, now = Combination.read(row), Combination.of(engine.settings)
    # A calls.json judges no stopping, and mount or speed may be others by now.
    judged = in_time([Candidate(chosen, 0.0, 0, (0, 0), 0)], now, engine.settings, config)
    if row.get("too_late") or not judged:
        raise DriveError(
            f"by setting {number} a thing is seen too late to stop: take another, see docs/stopping.md"
        )
    # Beside a region in metres the file's sides in fractions are not in force.
    if engine.settings.metres and chosen.region != now.region:
        raise DriveError(
            f"the region by {file} is in metres, and setting {number} has another: set [roi] near, far and "
            "width, and run the command anew; see docs/ground.md"
        )
    changes = differing(chosen, now)
    for line in row.get("warnings", ()):
        print(line)
    if told.get("prompts") != config.preferences.format():
        print(f"WARNING: it was judged with the words {told.get('prompts')}, and {file} has others")
    if not changes:
        print(f"setting {number} is in force in {file} already")
        return 0
    proposal = editing.propose(Path(file), changes)
    if proposal.problems:
        raise DriveError("\n".join([f"{file} cannot take setting {number}:", *map(str, proposal.problems)]))
    print(proposal.diff)
    if write:
        kept = editing.write(Path(file), proposal)
        print(f"setting {number} is in {file}, in force at its next start; the file before is {kept}")
    else:
        print(f"nothing is written: --write {file} does it")
    return 0


def _read(source: str, number: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return what a file tells, and the row of a setting."""
    data = read_regular(source, _MOST_BYTES + 1)
    anew = f"{source} is not of `companion tune` or `anytraverse calls`: give their tuning.json or calls.json"
    try:
        if len(data) > _MOST_BYTES:
            raise ValueError("too large")
        told = json.loads(data)
        rows = told["each"]
        count = len(rows)
        row = rows[number] if 0 <= number < count else None
    except (ValueError, RecursionError, KeyError, TypeError) as error:
        raise DriveError(anew) from error
    if row is None:
        raise DriveError(f"there is no setting {number} in {source}: it has 0 to {count - 1}")
    if not isinstance(row, dict) or not isinstance(row.get("warnings", []), list):
        raise DriveError(anew)
    return told, row
