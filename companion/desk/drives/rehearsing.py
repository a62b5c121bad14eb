"""Implements `companion rehearse`: which calls a drive would raise, answered at the desk."""

from __future__ import annotations

import json
import sys
import threading
import time
import webbrowser
from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from anytraverse.memory import Memory, first_memory
from companion.config import Config, load_config
from companion.desk.drives.desk import AnswerFile, Terminal, answer_lines, terminal
from companion.desk.drives.drive import Drive, DriveError
from companion.desk.drives.frames import open_drive
from companion.desk.drives.judge import DriveJudge
from companion.desk.drives.rehearsal import AskedCall, Rehearsal, learnt, rehearse
from companion.desk.drives.report import page as report_page
from companion.desk.memory.command import merged, read_checked
from companion.desk.memory.scene_file import Scene, write_scenes
from companion.vision.warm_up import load_engine
from companion.wire.call_report import reason_names

if TYPE_CHECKING:
    from companion.desk.drives.browser_desk import BrowserDesk

_TOLD_EVERY = 5.0
_OURS = ("frames.jsonl", "calls", "calls.json", "answers.txt", "memory.jsonl", "index.html")


def run(
    where: str,
    *,
    file: str,
    out: str,
    answers: str | None = None,
    memory: str | None = None,
    ask: bool = True,
    port: int | None = None,
) -> int:
    """Rehearse a drive, and write what it led to into the folder `out`. Returns 0, 1 without any frame.

    file: the configuration. answers: a file of answers. memory: an exported file of scenes that the rover
    begins with. ask: whether somebody is asked. port: of the page on which that is, 0: any free one; None:
    it is at the terminal.
    Raises DriveError, ConfigError, AnyTraverseError, MemoryCommandError, SceneFileError, OSError.
    """
    config = load_config(file)
    drive = open_drive(where, config.camera.rate)
    scripted = AnswerFile(Path(answers)) if answers else None
    before, pictures = _remembered(config, memory)
    judge = DriveJudge(config, load_engine(config, before)[0])
    folder = _made(Path(out))
    clock, found = judge.engine.memory.clock, Rehearsal()
    person: Terminal | BrowserDesk | None = (
        terminal(folder, lambda: judge.engine.memory) if ask and port is None else None
    )
    page = None
    if ask and port is not None:
        page = person = _browser_desk(judge, config, found, drive, port)

    def operator(call: AskedCall, problem: str) -> str | None:
        answer = scripted.ask(call, problem) if scripted is not None else None
        return person.ask(call, problem) if answer is None and person is not None else answer

    progress = _Progress(drive.count)

    def keep() -> None:
        _write_text(folder / "answers.txt", answer_lines(found.calls))

    def told(number: int) -> None:
        progress.frame(number, len(found.calls))
        if found.at_call[-1:] == [number]:
            keep()  # what was typed outlives a terminal that is closed
        if page is not None:
            page.progress(number)

    try:
        with page if page is not None else nullcontext():
            if page is not None:
                _open(page.url)
            rehearse(drive, judge, operator, folder, found, told)
    finally:
        keep()
    figures = {
        **found.figures(),
        "drive_s": round(found.drive_s, 1),
        "seconds": round(progress.seconds, 1),
        "model": judge.engine.perceiver.model_id,
    }
    kept = learnt(judge.engine.memory, clock, found.calls)
    _write(folder, drive.title, found, figures)
    if any(call.by_person for call in found.calls):
        shown = {call.id: call.judged for call in found.calls}
        scenes = [Scene(one, pictures.get(one.order) or shown.get(one.call_id, b"")) for one in kept.history]
        write_scenes(folder / "memory.jsonl", kept.model_id, scenes)
    _report(folder, found, figures, scripted.left() if scripted is not None else [])
    return 0 if found.frames else 1


def _browser_desk(
    judge: DriveJudge, config: Config, found: Rehearsal, drive: Drive, port: int
) -> BrowserDesk:
    """Make the page. Raises DriveError where its packages are not installed."""
    try:
        from companion.desk.drives.browser_desk import BrowserDesk
    except ImportError as error:
        raise DriveError(
            f'the page needs {error.name}: pip install "anytraverse-companion[ground]"; or omit --browser'
        ) from error
    if not 0 <= port <= 0xFFFF:
        raise DriveError(f"--port {port} is not in 0..65535")
    return BrowserDesk(judge, config.vocabulary, found, drive, port)


def _open(url: str) -> None:
    """Open a browser, and say where the page is."""
    print(f"Answer the calls at {url}\nCtrl-C ends the drive, and keeps what was answered.", flush=True)
    threading.Thread(target=webbrowser.open, args=[url], daemon=True).start()


def _remembered(config: Config, source: str | None) -> tuple[Memory | None, Mapping[int, bytes]]:
    """Return the memory that the rover begins with, None for a new one, and pictures by `Entry.order`."""
    if source is None:
        return None, {}
    perceiver, scenes = read_checked(config, Path(source))
    limit = config.journal.scenes
    begun = first_memory(perceiver.model_id, config.preferences, limit)
    memory, added, *_ = merged(begun, scenes, limit, perceiver.meaning)
    return memory, {one.entry.order: one.picture for one in added}


def _made(folder: Path) -> Path:
    """Make the folder, and clear what an earlier rehearsal wrote.

    Raises DriveError where others wrote, or where answers would be lost; and OSError.
    """
    folder.mkdir(parents=True, exist_ok=True)
    foreign = sorted({path.name for path in folder.iterdir()} - set(_OURS))
    if foreign:
        raise DriveError(f"{folder} holds {foreign[0]}, which no rehearsal wrote: give another --out")
    if (folder / "answers.txt").exists() and AnswerFile(folder / "answers.txt").left():
        raise DriveError(f"{folder / 'answers.txt'} holds answers, which would be lost: give another --out")
    for path in (*(folder / "calls").glob("*.jpg"), *(folder / name for name in _OURS if name != "calls")):
        path.unlink(missing_ok=True)
    return folder


def _write(folder: Path, title: str, found: Rehearsal, figures: dict[str, Any]) -> None:
    listed = [_listed(call) for call in found.calls]
    shown = report_page(f"Rehearsal of {title}", found, figures, str(folder / "answers.txt"))
    _write_text(folder / "calls.json", json.dumps({**figures, "each": listed}, indent=1) + "\n")
    _write_text(folder / "index.html", shown)


def _write_text(path: Path, text: str) -> None:
    """Write text. A file's name may hold bytes that are no text: they are written as `\\udcff`."""
    path.write_text(text, encoding="utf-8", errors="backslashreplace")


def _listed(call: AskedCall) -> dict[str, Any]:
    return {
        "id": call.id,
        "frame": call.frame,
        "at": round(call.at, 2),
        "scene": call.group,
        "reasons": reason_names(call.data.reasons),
        "answers": [{"answer": said.line, "text": said.text, "taken": said.taken} for said in call.said],
    }


def _report(folder: Path, found: Rehearsal, figures: dict[str, Any], unused: list[str]) -> None:
    if found.torn:
        print(f"{len(found.torn)} frames cannot be read, and are left out: {', '.join(found.torn[:5])}")
    for call in found.calls:
        for said in call.said:
            if not said.taken:
                print(f"{call.frame}: `{said.line}`: {said.text}")
    for frame in unused:
        print(f"{frame}: an answer was not used, because no call of this frame asked for it")
    print(
        f"{figures['calls']} calls in {figures['groups']} scenes, {figures['answered']} answered; "
        f"{figures['frames']} frames in {figures['seconds']:g} s"
    )
    print(f"{folder / 'index.html'} shows them")
    if (folder / "memory.jsonl").exists():
        print(f"the rover starts with what was answered: companion memory import {folder / 'memory.jsonl'}")
    elif found.calls:
        print(f"write answers into {folder / 'answers.txt'}, and rehearse again with --answers")
    print(json.dumps(figures))


class _Progress:
    """Prints how far it is, on stderr. seconds: since the start."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._began = self._told_at = time.monotonic()

    @property
    def seconds(self) -> float:
        return time.monotonic() - self._began

    def frame(self, number: int, calls: int) -> None:
        now = time.monotonic()
        if now - self._told_at > _TOLD_EVERY:
            self._told_at = now
            left = max(0, self._count - number) * (now - self._began) / number
            print(
                f"{number} of {self._count} frames, {calls} calls, {left:.0f} s left",
                file=sys.stderr,
            )
