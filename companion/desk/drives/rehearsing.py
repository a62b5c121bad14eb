"""Implements `companion rehearse`: which calls a drive would raise, answered at the desk, and their page."""

from __future__ import annotations

import json
import threading
import time
import webbrowser
from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from anytraverse.evaluation.progress import Progress, doing
from anytraverse.memory import Memory, first_memory
from anytraverse.release import to_install
from companion.config import Config, load_config
from companion.desk.drives.desk import AnswerFile, Terminal, answer_lines, terminal
from companion.desk.drives.drive import Drive, DriveError
from companion.desk.drives.frames import open_drive
from companion.desk.drives.judge import DriveJudge
from companion.desk.drives.rehearsal import AskedCall, Rehearsal, learnt, rehearse
from companion.desk.memory.command import merged, read_checked
from companion.desk.memory.scene_file import Scene, write_scenes
from companion.vision.warm_up import load_engine
from companion.wire.call_report import reason_names

if TYPE_CHECKING:
    from companion.desk.drives.browser_desk import BrowserDesk
from html import escape
from itertools import groupby

from anytraverse.html_page import document, figure
from companion.pages import wording

_OURS = ("frames.jsonl", "calls", "calls.json", "answers.txt", "memory.jsonl", "index.html")
_STYLE = """
h3 { margin: 1.2rem 0 .2rem; font-size: 1rem; }
p { margin: .2rem 0; }
.shots { max-width: 62rem; }
figure { margin: .4rem 0; }
code { overflow-wrap: anywhere; }
.tenths { display: flex; gap: .3rem; align-items: end; height: 7rem; max-width: 30rem; margin: 1rem 0;
  padding: 0; list-style: none; }
.tenths li { flex: 1; text-align: center; font-size: .85rem; }
.tenths div { background: var(--green); border-radius: 2px 2px 0 0; }
"""
_TALLEST = 70


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
    with doing(f"opening {where}"):
        drive = open_drive(where, config.camera.rate)
    scripted = AnswerFile(Path(answers)) if answers else None
    before, pictures = _remembered(config, memory)
    with doing(f"loading {config.perceiver.name}"):
        judge = DriveJudge(config, load_engine(config, before)[0])
    folder = _made(Path(out))
    clock, found = judge.engine.memory.clock, Rehearsal()
    person: Terminal | BrowserDesk | None = (
        terminal(folder, judge.engine, found) if ask and port is None else None
    )
    page = None
    if ask and port is not None:
        page = person = _browser_desk(judge, config, found, drive, port)

    def operator(call: AskedCall, problem: str) -> str | None:
        answer = scripted.ask(call, problem) if scripted is not None else None
        if answer is not None or person is None:
            return answer
        with progress.waiting():
            return person.ask(call, problem)

    began, progress = time.monotonic(), Progress(drive.count, "frames")

    def keep() -> None:
        _write_text(folder / "answers.txt", answer_lines(found.calls))

    def told(number: int) -> None:
        progress.reach(number, f", {len(found.calls)} calls")
        if found.at_call[-1:] == [number]:
            keep()  # what was typed outlives a terminal that is closed
        if page is not None:
            page.progress(number)

    try:
        with page if page is not None else nullcontext(), progress:
            if page is not None:
                _open(page.url)
            rehearse(drive, judge, operator, folder, found, told)
    finally:
        keep()
    figures = {
        **found.figures(),
        "drive_s": round(found.drive_s, 1),
        "seconds": round(time.monotonic() - began, 1),
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
        raise DriveError(f"the page needs {error.name}: {to_install('ground')}; or omit --browser") from error
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
    shown = _page(f"Rehearsal of {title}", found, figures, str(folder / "answers.txt"))
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


def _page(title: str, rehearsal: Rehearsal, figures: Mapping[str, Any], answers: str) -> str:
    """Return the page. title: names the drive. answers: where the file of answers is."""
    parts = [f"<h1>{escape(title)}</h1>", f"<p>{_headline(figures)}</p>", _tenths(figures["by_tenth"])]
    if any(not call.by_person for call in rehearsal.calls):
        parts.append(
            "<p>Calls that nobody answered got a go, so that each place is asked about once. They are not "
            f"remembered. Write an answer for each into <code>{escape(answers)}</code>, and rehearse again "
            "with <code>--answers</code>.</p>"
        )
    by_group = sorted(rehearsal.calls, key=lambda call: (call.group, call.id))
    for group, found in groupby(by_group, key=lambda call: call.group):
        alike = list(found)
        parts.append(f"<h2>Scene {group}: {len(alike)} {'call' if len(alike) == 1 else 'calls'}</h2>")
        parts += map(_call, alike)
    return document(title, _STYLE, parts)


def _headline(figures: Mapping[str, Any]) -> str:
    return (
        f"Calls: {figures['calls']}, in {figures['groups']} scenes; answered: {figures['answered']}. "
        f"Remembered places known again: {figures['matches']}. "
        f"Frames: {figures['frames']}, {figures['drive_s']:g} s of the drive; not OK: {figures['not_ok']}. "
        f"Holds, if policy hold were in force: {figures['would_hold']}."
    )


def _tenths(tenths: list[int]) -> str:
    most = max(1, *tenths)
    bars = (
        f'<li>{count or ""}<div style="height:{round(_TALLEST * count / most)}px"></div>{number}</li>'
        for number, count in enumerate(tenths, 1)
    )
    return f'<p class="faint">Calls in each tenth of the drive</p><ol class="tenths">{"".join(bars)}</ol>'


def _call(call: AskedCall) -> str:
    said = [f"<p><code>{escape(line)}</code>: {escape(text)}</p>" for line, text, _ in call.said]
    return "".join(
        [
            f"<h3>C{call.id} at {call.at:.1f} s, {escape(call.frame)}</h3>",
            f"<p>{escape(wording.reason(call.data))}</p>",
            f'<p class="faint">{escape(wording.figures(call.data))}</p>',
            '<div class="shots">',
            figure(call.raw, "What the camera saw"),
            figure(call.judged, "How it was judged"),
            "</div>",
            *(said or ['<p class="faint">Not answered.</p>']),
        ]
    )
