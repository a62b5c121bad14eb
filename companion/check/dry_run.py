"""`companion check --dry-run`: the running companion raises a test call, and the ground answers it."""

from __future__ import annotations

import contextlib
import json
import os
import time
from pathlib import Path
from typing import Any

from companion.check.here import state_folder, status
from companion.config import ConfigError, load_config
from companion.trial import ANSWERED_WITHIN, REQUEST

TAKEN_WITHIN = 6.0
"""Seconds: it is looked for four times, and the status file written once, a second."""
_STEP = 0.1
_OVER = {"answered": 0, "unanswered": 1, "cut short": 1, "refused": 1}


class _DryRunError(Exception):
    """No test call could be raised; the text says what to do."""


def dry_run(file: str, *, as_json: bool = False) -> int:
    """0 where the test call was answered, else 1."""
    said: dict[str, Any] = {}
    try:
        said = _dry_run(state_folder(load_config(file)))
        text = str(said["text"])
    except (ConfigError, _DryRunError) as error:
        text = str(error)
    answered = said.get("state") == "answered"
    print(f"{'pass' if answered else 'fail'}  test call  {text}")
    if as_json:
        print(json.dumps({"ok": answered, "test_call": said, "text": text}))
    return 0 if answered else 1


def _dry_run(folder: Path) -> dict[str, Any]:
    if status(folder) is None:
        raise _DryRunError(
            f"no companion runs with {folder}: start the companion first, then type this again"
        )
    asked = _ask(folder)
    deadline, told = time.monotonic() + TAKEN_WITHIN, False
    while time.monotonic() < deadline:
        said = (status(folder) or {}).get("test_call") or {}
        if (refused := said.get("refused") or {}).get("asked") == asked:
            return {**refused, "id": 0, "state": "refused"}
        if said.get("asked") == asked:
            if said.get("state") in _OVER:
                return dict(said)
            if not told:
                told, deadline = True, time.monotonic() + ANSWERED_WITHIN + TAKEN_WITHIN
                print(
                    f"call {said['id']} is told to the ground: answer it there within {ANSWERED_WITHIN:.0f} s"
                )
        time.sleep(_STEP)
    with contextlib.suppress(OSError):
        (folder / REQUEST).unlink()
    raise _DryRunError("the companion that runs does not react: is it still starting? See its log")


def _ask(folder: Path) -> int:
    """Leave the request; when it was written, in ns."""
    path = folder / REQUEST
    try:
        left = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600)
        try:
            return os.fstat(left).st_mtime_ns
        finally:
            os.close(left)
    except FileExistsError:
        raise _DryRunError("a test call was asked for a moment ago: wait for it") from None
    except OSError as error:
        raise _DryRunError(
            f"{path}: {(error.strerror or str(error)).lower()}: type this with sudo"
        ) from error
