"""Kills the companion, and cuts its power, at random points of what it writes to disk.

`python -m bench.faults.power_loss --kills 500 --cuts 200`. An operator answers calls with words and sets a
parameter. The daemon is the one that ships, in virtual time, with a simulated vision process. In each kill a
process gets SIGKILL just before a random change of a file. For the cuts the changes of one run are recorded,
and the disk is computed as a loss of power leaves it: without all that was not synced, or with a random part
of it. Then the journal is opened, as at the next start, and compared with what the operator had been told.
Its last line is JSON.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import logging
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from pymavlink.dialects.v20 import development as mavlink

from anytraverse.operations import SetWord
from bench.faults.disk_replay import Disk, DiskChange, lay_out, read_record
from bench.link.lossy import Radio, drive_in_virtual_time
from bench.link.operator import Operator
from bench.link.radio_model import LinkConditions
from bench.link.rover import Rover
from bench.shim import compile_shim, preloading
from bench.virtual_time import virtual_time
from companion.storage import Journal, JournalError
from companion.wire.ids import COMPONENT_ID, Result
from companion.wire.parameters import SUMMARY_RATE
from gcs_plugin.client import events as ev

CALLS = 8
"""Calls of one run. Each kind of answer comes twice."""
_SOURCE = Path(__file__).with_name("recording_disk.c")
_STARTED = "POWER_LOSS_SHIM"
_REMEMBERED = (Result.APPLIED, Result.NOT_COVERED)
_SET_EVERY = 100
"""Turns between two settings of a parameter: two seconds."""
_HIGHEST_RATE = 4.0


class Notes:
    """Writes down what the operator has been told, a JSON line each; a killed process loses none.

    Each line has `at`: the bytes of the record of changes at that moment.
    """

    def __init__(self, path: Path, record: Path) -> None:
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        self._record = record

    def add(self, **what: object) -> None:
        line = json.dumps({**what, "at": self._record.stat().st_size if self._record.exists() else 0})
        os.write(self._file, f"{line}\n".encode())


class NotedOperator(Operator):
    """An operator whose acknowledged answers, calls and parameters are noted."""

    def __init__(self, radio: Radio, seed: str, rover: Rover, notes: Notes) -> None:
        super().__init__(radio, seed, lambda: rover.shows)
        self._rover = rover
        self._notes = notes
        self._encoder = mavlink.MAVLink(None, 255, 190)
        self._radio = radio
        self._turns = 0

    def step(self, now: float) -> None:
        super().step(now)
        self._turns += 1
        if self._turns % _SET_EVERY == 0:
            value = 1.0 + self._turns / _SET_EVERY % 300 / 100
            message = mavlink.MAVLink_param_set_message(1, COMPONENT_ID, SUMMARY_RATE.encode(), value, 9)
            self._radio.write(bytes(message.pack(self._encoder)))

    def _hear(self, event: ev.Event, now: float) -> None:
        super()._hear(event, now)
        match event:
            case ev.CallAnnounced(call=call):
                self._notes.add(call=call.id, shows=self._rover.shows)
            case ev.Acknowledged(acknowledgement=ack) if ack.result in _REMEMBERED:
                answers = self.calls[ack.target].answers if ack.target in self.calls else []
                sent = [one.answer for one in answers if one.answer.transaction == ack.transaction]
                words = {
                    op.word: op.weight for one in sent for op in one.operations if isinstance(op, SetWord)
                }
                self._notes.add(transaction=ack.transaction, words=words)
            case ev.ParameterReceived(name=name, value=value) if name == SUMMARY_RATE:
                self._notes.add(rate=round(value, 6))


def work(folder: Path, record: Path, notes: Path, seed: str, kill_before: int) -> None:
    """Let the companion answer `CALLS` calls in `folder`. kill_before: number of a change; 0: no kill."""
    recorder = ctypes.CDLL(None)
    recorder.recorder_start.argtypes = [ctypes.c_char_p, ctypes.c_char_p, ctypes.c_long]
    with virtual_time() as clock:
        radio = Radio(LinkConditions(), seed)
        recorder.recorder_start(bytes(folder), bytes(record), kill_before)
        rover = Rover(folder, lambda: radio.near, pictures=20)
        operator = NotedOperator(radio, seed, rover, Notes(notes, record))
        outcome = drive_in_virtual_time(clock, radio, rover, operator, CALLS)
    if not outcome.good:
        raise RuntimeError(f"not all calls were answered: {outcome}")


def work_in_child(folder: Path, seed: str, kill_before: int) -> int:
    """Run `work` in a forked process and a new folder; returns its exit status, negative for a signal."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    pid = os.fork()
    if pid == 0:
        code = 1
        try:
            work(folder / "state", folder / "record", folder / "notes", seed, kill_before)
            code = 0
        finally:
            sys.stderr.flush()
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])


def read_notes(path: Path, until: float = float("inf")) -> list[dict[str, Any]]:
    """Read what the operator had been told when the record had `until` bytes."""
    lines = path.read_text().splitlines() if path.exists() else []
    return [note for line in lines if (note := json.loads(line))["at"] <= until]


MISSING = "frame of the open call missing"
"""A call's frame reaches the disk some turns later. A start without it takes the newest, and says so."""


def check(folder: Path, notes: Sequence[Mapping[str, Any]], pictures: Mapping[str, set[bytes]]) -> list[str]:
    """Open the journal as at the next start, and return all that is wrong with it, and `MISSING`.

    pictures: name of a served picture -> all contents that were ever completely written under it.
    """
    wrong = []
    try:
        journal = Journal(folder)
    except JournalError as error:
        return [f"journal cannot be opened: {error}"]
    try:
        # A file that was only just created may be empty: then nobody had been told anything.
        if journal.recovered_from is not None and notes:
            wrong.append("journal damaged")
        memory, state = journal.load_memory(), journal.load_supervision() or {}
        words = {word: memory.preferences[word] for word in memory.preferences} if memory else {}
        told: dict[str, float] = {}
        transactions = []
        for note in notes:
            told |= note.get("words", {})
            transactions += [note["transaction"]] if "transaction" in note else []
        wrong += [
            f"word lost: {word}" for word, weight in told.items() if abs(words.get(word, 9.0) - weight) > 1e-3
        ]
        known = {row[2] for row in state.get("replies", [])}
        wrong += [f"answer {one} would count twice" for one in transactions[-8:] if one not in known]
        rates = [note["rate"] for note in notes if "rate" in note]
        saved = (state.get("settings") or {}).get("values", {}).get(SUMMARY_RATE, [0.0])[0]
        # The parameter rises, so a value above the one that was echoed is a newer one.
        if len(rates) > 1 and saved < rates[-1] - 1e-5:
            wrong.append(f"parameter lost: {rates[-1]} echoed, {saved} on disk")
        calls = {note["call"]: note["shows"] for note in notes if "call" in note}
        if calls and state.get("last_id", 0) < max(calls):
            wrong.append(f"id used twice: {max(calls)} announced, {state.get('last_id')} on disk")
        wrong += _wrong_frame(journal, state.get("call"), calls)
    finally:
        journal.close()
    for path in (folder / "calls").glob("*.jpg"):
        if path.read_bytes() not in pictures.get(path.name, set()):
            wrong.append("served picture torn")
    return wrong


def _wrong_frame(journal: Journal, call: Mapping[str, Any] | None, calls: Mapping[int, int]) -> Iterable[str]:
    if not call:
        return
    png = journal.load_frame(call["frame_id"])
    if png is None:
        yield MISSING
        return
    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        yield "frame of the open call torn"
    elif call["id"] in calls and int(image[0, 0, 2]) << 8 | int(image[0, 0, 1]) != calls[call["id"]]:
        yield "wrong frame with a call"


def written_pictures(changes: Iterable[DiskChange]) -> dict[str, set[bytes]]:
    """Return all contents that were completely written and then got a picture's name."""
    contents: dict[str, set[bytes]] = {}
    disk: Disk | None = None
    for change in changes:
        disk = disk or Disk(change.path.rpartition("/")[0])
        disk.apply(change)
        if change.kind in "rl" and change.other.endswith(".jpg"):
            contents.setdefault(Path(change.other).name, set()).add(disk.now()[change.other])
    return contents


def kills(count: int, seed: int, folder: Path) -> dict[str, Any]:
    """Kill `count` processes and return the figures."""
    chance, wrong = random.Random(seed), Counter[str]()
    whole = _recorded(folder / "whole", str(seed))
    pictures, changes, killed = written_pictures(whole), len(whole), 0
    for number in range(count):
        place = folder / "kill"
        at = chance.randint(1, changes)
        status = work_in_child(place, str(seed), at)
        killed += status == -9
        found = check(place / "state", read_notes(place / "notes"), pictures)
        wrong.update(found)
        _report(f"kill {number} before change {at} of {changes}", found)
    return {"kills": killed, "changes": changes, **_figures(wrong)}


def cuts(count: int, seed: int, folder: Path) -> dict[str, Any]:
    """Cut the power `count` times in each of the two ways, and return the figures."""
    chance, wrong = random.Random(seed), (Counter[str](), Counter[str]())
    changes = _recorded(folder / "whole", str(seed))
    root = str(folder / "whole" / "state")
    pictures = written_pictures(changes)
    disk, told = Disk(str(folder / "whole")), folder / "whole" / "notes"
    points = sorted(chance.sample(range(1, len(changes) + 1), min(count, len(changes))))
    at = 0
    for point in points:
        for change in changes[at:point]:
            disk.apply(change)
        at = point
        notes = read_notes(told, changes[point - 1].end)
        for results, part in zip(wrong, (None, random.Random(f"{seed} {point}")), strict=True):
            place = folder / "cut"
            shutil.rmtree(place, ignore_errors=True)
            place.mkdir()
            lay_out(disk.content(part), root, place)
            found = check(place, notes, pictures)
            results.update(found)
            _report(f"cut after change {point}, {'a part of' if part else 'all'} the unsynced lost", found)
    return {"cuts": len(points), "all": _figures(wrong[0]), "in_part": _figures(wrong[1])}


def _report(what: str, found: Sequence[str]) -> None:
    if set(found) - {MISSING}:
        print(f"{what}: {'; '.join(found)}", flush=True)


def _figures(found: Counter[str]) -> dict[str, Any]:
    wrong = {what: times for what, times in found.items() if what != MISSING}
    return {"wrong": wrong, "frames_missing": found[MISSING]}


def _recorded(folder: Path, seed: str) -> list[DiskChange]:
    """Run once without a kill. Checks that the record says what the disk holds."""
    status = work_in_child(folder, seed, 0)
    if status:
        raise RuntimeError(f"the companion ended with {status}")
    changes = read_record(folder / "record")
    disk = Disk(str(folder))
    for change in changes:
        disk.apply(change)
    seen = {path: data for path, data in disk.now().items() if not path.endswith("/")}
    real = {str(path): path.read_bytes() for path in (folder / "state").rglob("*") if path.is_file()}
    if seen != real:
        differ = sorted(path for path in seen.keys() | real.keys() if seen.get(path) != real.get(path))
        raise RuntimeError(f"the record does not say what the disk holds: {differ}")
    return changes


def _preloaded(arguments: Sequence[str]) -> int:
    """Start this program again, with the shim loaded."""
    with tempfile.TemporaryDirectory() as folder:
        preload = preloading(compile_shim(_SOURCE, Path(folder)))
        command = [sys.executable, "-m", "bench.faults.power_loss", *arguments]
        return subprocess.run(command, env={**os.environ, **preload, _STARTED: "1"}, check=False).returncode


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the bench; returns 0 when nothing is wrong after any kill and any cut."""
    given = sys.argv[1:] if arguments is None else list(arguments)
    parser = argparse.ArgumentParser(prog="python -m bench.faults.power_loss", description=__doc__)
    parser.add_argument("--kills", type=int, default=500)
    parser.add_argument("--cuts", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(given)
    if _STARTED not in os.environ:
        return _preloaded(given)
    logging.disable(logging.CRITICAL)
    with tempfile.TemporaryDirectory() as folder:
        killed = kills(options.kills, options.seed, Path(folder))
        cut = cuts(options.cuts, options.seed, Path(folder))
    print(json.dumps({"killed": killed, "cut": cut}))
    return 1 if killed["wrong"] or cut["all"]["wrong"] or cut["in_part"]["wrong"] else 0


if __name__ == "__main__":
    sys.exit(main())
