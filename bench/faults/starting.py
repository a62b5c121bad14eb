"""Rows of the fault table: journals of other versions, unclean stops, two daemons; and those of clocks."""

from __future__ import annotations

import json
import sqlite3
import time
from pathlib import Path

from anytraverse.operations import SetWord
from bench.faults import clocks
from bench.faults.row import RowOutcome, Work
from bench.faults.standing import Standing, repeating
from bench.faults.standing_calls import comes_back, drive_on, held_call, still_open
from bench.faults.standing_wire import HOLD
from companion.storage.database import VERSION
from companion.wire.ids import Motion, Result


def _answer_with_its_picture(rover: Standing, call: int, word: str, wrong: list[str]) -> None:
    """Answer a word that does not cover the thing. Only the call's own picture shows it by now."""
    rover.thing = False
    given = rover.answer(call, Motion.NONE, [SetWord(word, 1.0)])
    if given.result is not Result.NOT_COVERED or (given.roi_uncertainty or 0.0) < 0.5:
        wrong.append(f"not judged by the call's picture: {given.result.name}, {given.roi_uncertainty}")
    if any("lost" in text for text in rover.texts()):
        wrong.append("it said that something was lost")


def _make_older(state: Path, version: int) -> None:
    """Make the journal one of an older version, as that version wrote it."""
    connection = sqlite3.connect(state / "journal.db")
    with connection:
        (png,) = connection.execute("SELECT png FROM frame").fetchone()
        (state / "call.png").write_bytes(png)
        connection.execute("DROP TABLE frame")
        if version < 2:
            for column in ("roll", "pitch", "yaw"):
                connection.execute(f"ALTER TABLE entries DROP COLUMN {column}")
        connection.execute(f"PRAGMA user_version = {version}")
    connection.close()


def _stored_version(path: Path) -> int:
    connection = sqlite3.connect(f"file:{path}?mode=ro", uri=True)
    try:
        return int(connection.execute("PRAGMA user_version").fetchone()[0])
    finally:
        connection.close()


def _older_journal(work: Work) -> RowOutcome:
    wrong, back = list[str](), 0.0
    for version in range(1, VERSION):
        folder = work.folder / str(version)
        folder.mkdir()
        with Standing(folder, policy="hold", seed=work.seed) as rover:
            rover.start()
            call = held_call(rover)
            rover.answer(call, Motion.NONE, [SetWord("gravel", 1.0)])
            rover.kill()
            _make_older(rover.state, version)
            began = time.monotonic()
            rover.start()
            back = max(back, comes_back(rover, call, began))
            rover.wait("its status", lambda: "words" in rover.status(), 5.0)
            if rover.status()["words"] != "grass: 1; sky: -1; gravel: 1":
                wrong.append(f"version {version}: words in use: {rover.status()['words']}")
            _answer_with_its_picture(rover, call, "dirt path", wrong)
            drive_on(rover, call, wrong)
            rover.stop()
            copy = rover.state / f"journal.version-{version}.db"
            found = _stored_version(rover.state / "journal.db"), _stored_version(copy)
            if found != (VERSION, version):
                wrong.append(f"version {version}: journal and copy are of versions {found}")
    return RowOutcome(
        VERSION - 1, tuple(wrong), None, back, "call, picture and words are there; a copy is kept"
    )


def _newer_journal(work: Work) -> RowOutcome:
    wrong = list[str]()
    with Standing(work.folder, seed=work.seed) as rover:
        rover.start()
        rover.stop()
        path = rover.state / "journal.db"
        connection = sqlite3.connect(path)
        connection.execute(f"PRAGMA user_version = {VERSION + 1}")
        connection.close()
        whole, before = path.read_bytes(), len(rover.log)
        rover.start(wait=False)
        rover.wait("its end", lambda: rover.daemon is None or not rover.daemon.running, 20.0, runs=False)
        assert rover.daemon is not None
        said = rover.log[before:].strip()
        if rover.daemon.process.returncode != 2 or "newer companion" not in said or "Traceback" in said:
            wrong.append(f"exit code {rover.daemon.process.returncode}: {said}")
        if path.read_bytes() != whole:
            wrong.append("the newer journal was changed")
        path.unlink()
        back = rover.start()
    return RowOutcome(1, tuple(wrong), None, back, said.replace(str(rover.state), "STATE"))


def _shows_picture(rover: Standing, call: int) -> bool:
    record = json.loads((rover.state / "calls" / f"{call}.json").read_text())
    return bool(record.get("picture") == f"/calls/{call}.jpg")


def _unclean_stop(work: Work) -> RowOutcome:
    wrong = list[str]()
    with Standing(work.folder, policy="hold", seed=work.seed) as rover:
        rover.start()
        call = held_call(rover)
        picture = rover.state / "calls" / f"{call}.jpg"
        rover.wait("its picture", picture.is_file, 10.0)
        rover.run(0.3)
        rover.kill()
        began = time.monotonic()
        rover.start()
        back = comes_back(rover, call, began)
        still_open(rover, call, "after the start", wrong)
        rover.wait("its picture in the call's record", lambda: _shows_picture(rover, call), 10.0)
        _answer_with_its_picture(rover, call, "gravel", wrong)
        drive_on(rover, call, wrong)
    return RowOutcome(1, tuple(wrong), None, back, f"call {call}, held, with its picture")


def _two_on_one_folder(work: Work) -> RowOutcome:
    wrong = list[str]()
    with Standing(work.folder, policy="hold", seed=work.seed) as rover:
        rover.start()
        since = len(rover.events)
        second = rover.another("second", rover.config)
        rover.wait("the second one's end", lambda: not second.running, 20.0)
        said = second.log.read_text().strip()
        if second.process.returncode != 2 or "another companion runs" not in said or "Traceback" in said:
            wrong.append(f"the second ended with {second.process.returncode}: {said}")
        rover.run(1.2)
        if not rover.summaries(since) or len(rover.wire.senders) != 1:
            wrong.append("the first was disturbed")
        call = held_call(rover)
        hold_s = rover.wire.modes[-1][0] - rover.clear_at
        drive_on(rover, call, wrong)
    return RowOutcome(1, tuple(wrong), hold_s, None, said.replace(str(rover.state), "STATE"))


def _two_on_one_link(work: Work) -> RowOutcome:
    """Two daemons under the same ids, and each hears the other. One that speaks is ended at last."""
    wrong = list[str]()
    with Standing(work.folder, policy="hold", seed=work.seed) as rover:
        rover.start()
        assert rover.daemon is not None
        pair = [rover.daemon, rover.another("second", rover.config_with(work.folder / "other"))]
        try:
            said = "another component 1/191 talks on link"
            rover.wait("that one notices", lambda: any(said in one.log.read_text() for one in pair), 20.0)
            rover.run(3.5)
            held_call(rover)
            hold_s = rover.wire.modes[-1][0] - rover.clear_at
            rover.thing = False
            rover.run(1.0 if work.short else 15.0)
            if rover.wire.mode != HOLD:
                wrong.append("it was driven on without a go")
            silent = next(one for one in pair if said in one.log.read_text())
            speaking = next(one for one in pair if one is not silent)
            speaking.process.kill()
            speaking.process.wait(10.0)
            rover.daemon, began = silent, time.monotonic()
            beats = rover.client.rovers[1]
            rover.wait("the other", lambda: beats.silence(time.monotonic()) < time.monotonic() - began, 20.0)
            back = time.monotonic() - began
            rover.wait("its call or hold", lambda: beats.current_id > 0, 5.0)
            drive_on(rover, beats.current_id, wrong)
        finally:
            for one in pair:
                one.process.kill()
                one.process.wait(10.0)
    return RowOutcome(1, tuple(wrong), hold_s, back, f'"{said}: stop it, or this one stays silent"')


ROWS = (
    *clocks.ROWS,
    repeating(
        "journal of a previous version",
        "a start on journals of each older version, with an open call",
        "call and words stay; a copy is kept",
        2,
        _older_journal,
    ),
    repeating(
        "journal of a newer version",
        "a start on a journal whose version is one higher",
        "does not start, says what to do",
        2,
        _newer_journal,
    ),
    repeating(
        "unclean stop with an open call",
        "SIGKILL while the rover is held before an unknown thing",
        "call and hold stand",
        20,
        _unclean_stop,
    ),
    repeating(
        "two daemons with one state folder",
        "a second `companion run` with the same configuration",
        "the second ends, says why",
        5,
        _two_on_one_folder,
        holds=True,
        returns=False,
    ),
    repeating(
        "two daemons with one system id",
        "a second daemon with another state folder on the same wire; each hears the other",
        "one falls silent but for holds",
        3,
        _two_on_one_link,
        holds=True,
    ),
)
"""Of starts and clocks."""
