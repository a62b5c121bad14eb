"""Shows a running companion's status (`companion status`) and requests its test call (`--dry-run`)."""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from companion.config import ConfigError, Problem, load_config, state_folder
from companion.desk.check.computer import check_space
from companion.desk.check.here import RUNNING, is_alive, read_status, status
from companion.desk.check.observers import told_recordings
from companion.wire.ids import Policy

WELL, FAULTY, NOT_RUNNING = 0, 1, 2
_WIDTH = 10


def print_status(file: str, *, as_json: bool = False) -> int:
    """Print the status. Returns 0 if the companion runs and is well, 1 if it is faulty, 2 if none runs."""
    said: dict[str, Any] = {}
    try:
        folder = state_folder(load_config(file))
        age, said = _read(folder)
        code, verdict = _verdict(folder, age, said)
    except ConfigError as error:
        age, code, verdict = None, NOT_RUNNING, str(error)
    print(verdict)
    for name, text in _rows(folder, said) if code != NOT_RUNNING else ():
        print(f"{name:<{_WIDTH}}  {text}")
    if as_json:
        shown = None if age is None else round(age, 1)
        print(json.dumps({"code": code, "text": verdict, "age": shown, "status": said}))
    return code


def _read(folder: Path) -> tuple[float | None, dict[str, Any]]:
    try:
        return read_status(folder)
    except PermissionError as error:
        path = folder / "status.json"
        raise ConfigError([Problem(path, None, "", None, "may not be read: type this with sudo")]) from error


def _verdict(folder: Path, age: float | None, said: Mapping[str, Any]) -> tuple[int, str]:
    if age is None:
        return NOT_RUNNING, f"no companion runs with {folder}, or it is still starting: see its log"
    pid = said.get("pid")
    began = started_at(pid)
    # A process that was started after the file was written is another one with the same number.
    another = began is not None and began > time.time() - age + RUNNING
    if another or not is_alive(pid):
        how = f"process {pid} {'was stopped' if 'recent' in said else 'died'} {_duration(age)} ago"
        return NOT_RUNNING, f"no companion runs, or it is still starting: {how}: see its log"
    if age > RUNNING:
        silent = f"has written no status for {_duration(age)}: it hangs, or its disk is full or fails"
        return FAULTY, f"the companion, process {pid}, {silent}; what follows is old"
    state, trouble = said.get("state"), _table(said, "link").get("trouble")
    if state == "fault":
        return FAULTY, f"the companion runs, process {pid}, and cannot judge: FAULT"
    if trouble:
        return FAULTY, f"the companion runs, process {pid}, and its link fails"
    return WELL, f"the companion runs, process {pid}"


def _rows(folder: Path, said: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    names = ("camera", "link", "perceiver", "vision", "disk", "judging")
    camera, link, perceiver, vision, written, judging = (_table(said, name) for name in names)
    reasons = ", ".join(map(str, said.get("reasons") or ()))
    yield "state", f"{said.get('state', 'unknown')}{': ' if reasons else ''}{reasons}"
    refused = said.get("hold_refused")
    yield (
        "policy",
        f"{said.get('policy', 'unknown')}{f'; hold cannot be given: {refused}' if refused else ''}",
    )
    if said.get("policy") == Policy.GUIDE.name.lower():
        guide = _table(said, "guide")
        lacks = guide.get("lacks")
        yield "guide", f"{guide.get('state', 'unknown')}{f': {lacks}' if lacks else ''}"
    yield "open", f"call or hold {said['current_id']}" if said.get("current_id") else "no call, no hold"
    why = camera.get("reason")
    yield (
        "camera",
        (
            f"{camera.get('state', 'unknown')}{f': {why}' if why else ''}, {_picture(camera)}"
            f"{camera.get('read', 0)} frames read, {said.get('frames', 0)} judged"
            f"{', shows infrared (NoIR)' if camera.get('infrared') else ''}"
        ),
    )
    lowered = ""
    if judging.get("lowered_by"):
        rates = f"{judging.get('rate')} frames/s of {judging.get('configured')}"
        lowered = f", {rates}: {judging['lowered_by']}"
    model, step = perceiver.get("model", "unknown"), perceiver.get("step_ms", 0)
    yield "perceiver", f"{model}, {step} ms a frame{lowered}"
    restarts = vision.get("restarts", 0)
    yield (
        "vision",
        f"{vision.get('trouble') or 'running'}{f', started again {restarts} x' if restarts else ''}",
    )
    heard = link.get("autopilot")
    yield (
        "link",
        str(link.get("trouble") or (f"autopilot on {heard}" if heard else "no autopilot is heard yet")),
    )
    yield "computer", _computer(_table(said, "computer"))
    yield "words", str(said.get("words") or "none")
    yield "disk", f"{'not written now; ' if written.get('failing') else ''}{check_space(folder).text}"
    recording = _table(said, "recording")
    yield "recording", str(recording.get("trouble") or told_recordings(recording))
    live = _table(said, "live")
    viewers = f"{live.get('url') or 'nowhere'}, {live.get('clients', 0)} viewers"
    yield "live view", str(live.get("trouble") or viewers)
    since = started_at(said.get("pid"))
    if since is not None:
        at = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(since))
        yield "since", f"{at}, for {_duration(time.time() - since)}"


def _computer(told: Mapping[str, Any]) -> str:
    """Return temperature, load and memory in one line; what the computer does not tell is left out."""
    degrees, cpu, free, total = (told.get(name) for name in ("temperature", "cpu", "memory_free", "memory"))
    parts = (
        f"{degrees:.0f} C" if isinstance(degrees, float) else "no temperature told",
        "slowed down" if told.get("throttled") else "",
        "the supply's voltage is too low" if told.get("under_voltage") else "",
        f"CPU {100 * cpu:.0f} %" if isinstance(cpu, float) else "",
        f"{free} of {total} MiB memory free" if free is not None and total is not None else "",
    )
    return ", ".join(part for part in parts if part)


def _picture(camera: Mapping[str, Any]) -> str:
    """Say the size of the pictures, and what their capture times are from."""
    if not camera.get("width"):
        return ""
    return f"{camera['width']} x {camera.get('height')}, time from {camera.get('timed_by') or 'nothing'}, "


def _table(said: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    found = said.get(name)
    return found if isinstance(found, dict) else {}


def started_at(pid: object) -> float | None:
    """Return when the process was started, in seconds since 1970; None when /proc does not say."""
    try:
        ticks = int(Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[19])
        uptime = float(Path("/proc/uptime").read_text(encoding="utf-8").split()[0])
    except (OSError, ValueError, IndexError):
        return None
    return time.time() - uptime + ticks / os.sysconf("SC_CLK_TCK")


def _duration(seconds: float) -> str:
    whole = max(0, int(seconds))
    if whole < 120:
        return f"{whole} s"
    if whole < 2 * 3600:
        return f"{whole // 60} min"
    return f"{whole // 3600} h" if whole < 48 * 3600 else f"{whole // 86400} days"


TAKEN_WITHIN = 6.0
"""Seconds for the companion to react. It looks for requests 4 times a second and writes its status once."""
_STEP = 0.1
_OVER = {"answered": 0, "unanswered": 1, "cut short": 1, "refused": 1}


class _DryRunError(Exception):
    """No test call could be started; the text says what to do."""


def dry_run(file: str, *, as_json: bool = False) -> int:
    """Request a test call and wait for its answer. Returns 0 if it was answered, else 1."""
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
    from companion.daemon.trial_call import ANSWERED_WITHIN, REQUEST  # slow to import: `status` needs it not

    if status(folder) is None:
        _read(folder)  # a file that may not be read is told first
        raise _DryRunError(
            f"no companion runs with {folder}: start the companion first, then type this again"
        )
    asked = _ask(folder)
    deadline, announced = time.monotonic() + TAKEN_WITHIN, False
    while time.monotonic() < deadline:
        said = (status(folder) or {}).get("test_call") or {}
        if (refused := said.get("refused") or {}).get("asked") == asked:
            return {**refused, "id": 0, "state": "refused"}
        if said.get("asked") == asked:
            if said.get("state") in _OVER:
                return dict(said)
            if not announced:
                announced, deadline = True, time.monotonic() + ANSWERED_WITHIN + TAKEN_WITHIN
                print(
                    f"call {said['id']} is told to the ground: answer it there within {ANSWERED_WITHIN:.0f} s"
                )
        time.sleep(_STEP)
    with contextlib.suppress(OSError):
        (folder / REQUEST).unlink()
    raise _DryRunError("the companion that runs does not react: is it still starting? See its log")


def _ask(folder: Path) -> int:
    """Create the request file, and return its modification time in ns."""
    from companion.daemon.trial_call import REQUEST

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
