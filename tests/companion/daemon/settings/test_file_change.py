"""The supervisor asks for a change of its file, and hears what became of it."""

from __future__ import annotations

import hashlib
import os
from dataclasses import replace
from pathlib import Path

import pytest

from companion.config import root_helper
from companion.config.request import (
    LEAVE,
    LEAVE_LASTS,
    REQUEST,
    ConfigAnswer,
    clock,
    has_leave,
    read_request,
)
from companion.config.root_helper import answered, leave
from companion.daemon.settings.file_change import HEARD_WITHIN, LEAVE_STANDS, WITHIN, FileChange
from companion.vehicle.state import Vehicle

STANDS = Vehicle(1, 3, 0, armed=False, heard_at=100.0)
NOW = 100.5
BEFORE = b'[vehicle]\nfile = ""\n'
SHA256 = hashlib.sha256(BEFORE).hexdigest()


@pytest.fixture
def change(tmp_path: Path) -> FileChange:
    (tmp_path / "run").mkdir()
    (tmp_path / "answers").mkdir()
    (tmp_path / "companion.toml").write_bytes(BEFORE)
    return FileChange(tmp_path / "run", tmp_path / "answers")


def test_a_change_that_is_asked_for_is_made_by_the_helper_and_answered_once(
    change: FileChange, tmp_path: Path
) -> None:
    file = tmp_path / "companion.toml"
    assert change.answer(STANDS, NOW) is None
    assert change.ask({"camera.rate": 5.0}, SHA256, "10.0.0.7", STANDS, NOW) == ""
    assert change.answer(STANDS, NOW) is None
    assert "another change" in change.ask({"camera.rate": 6.0}, SHA256, "10.0.0.7", STANDS, NOW)
    leave(answered(file, tmp_path / "run", os.getuid()), tmp_path / "answers")
    found = change.answer(STANDS, NOW + 1.0)
    assert found is not None
    assert found.written
    assert b"rate = 5.0" in file.read_bytes()
    assert change.answer(STANDS, NOW + 1.0) is None
    assert "starting again" in change.ask({"camera.rate": 6.0}, SHA256, "10.0.0.7", STANDS, NOW + 1.0)
    change.watch(None, NOW + 1.0)
    assert change.ask({"camera.rate": 6.0}, SHA256, "10.0.0.7", STANDS, NOW) == ""
    assert change.answer(STANDS, NOW + 1.0) is None, "the answer to the one before is none to this"


def test_while_the_vehicle_is_armed_or_may_be_nothing_is_asked_for(
    change: FileChange, tmp_path: Path
) -> None:
    silent = NOW + HEARD_WITHIN
    for vehicle, now, why in (
        (replace(STANDS, armed=True), NOW, "disarm"),
        (None, NOW, "not known"),
        (STANDS, silent, "not known"),
        (replace(STANDS, heard_at=float("nan")), NOW, "not known"),
    ):
        assert why in change.ask({"camera.rate": 5.0}, SHA256, "x", vehicle, now)
    assert not list((tmp_path / "run").iterdir())


@pytest.fixture
def written(change: FileChange, tmp_path: Path) -> ConfigAnswer:
    """The helper's answer to a change that it has made, which lies there."""
    assert change.ask({"camera.rate": 5.0}, SHA256, "x", STANDS, NOW) == ""
    answer = answered(tmp_path / "companion.toml", tmp_path / "run", os.getuid())
    leave(answer, tmp_path / "answers")
    return answer


def allowed(tmp_path: Path, answer: ConfigAnswer) -> bool:
    return has_leave(tmp_path / "run", os.getuid(), answer.id, clock())


def test_a_file_that_is_written_is_followed_by_leave_to_start_again_for_seconds(
    change: FileChange, written: ConfigAnswer, tmp_path: Path
) -> None:
    assert not allowed(tmp_path, written)
    found = change.answer(STANDS, NOW)
    assert found is not None
    assert found.restarts
    change.watch(STANDS, NOW + 0.1)
    assert allowed(tmp_path, written)
    change.watch(replace(STANDS, heard_at=NOW + LEAVE_STANDS), NOW + LEAVE_STANDS)
    assert not list((tmp_path / "run").iterdir())


def test_a_leave_ends_before_the_restart_unless_it_is_renewed(
    change: FileChange, written: ConfigAnswer, tmp_path: Path
) -> None:
    assert LEAVE_LASTS < root_helper._GRACE, "a supervisor that hangs cannot take it back"
    change.answer(STANDS, NOW)
    change.watch(STANDS, NOW + 0.5)
    assert has_leave(tmp_path / "run", os.getuid(), written.id, clock())
    (tmp_path / "run" / LEAVE).unlink()
    change.watch(STANDS, NOW + 1.0)
    assert has_leave(tmp_path / "run", os.getuid(), written.id, clock())


def test_what_the_companion_before_asked_for_is_not_done_after_the_restart(tmp_path: Path) -> None:
    for name in (REQUEST, LEAVE):
        (tmp_path / name).write_text("{}")
    FileChange(tmp_path, tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("vehicle", "why"), [(replace(STANDS, armed=True), "is armed"), (None, "not known whether")]
)
def test_a_vehicle_that_is_armed_once_the_file_is_written_keeps_its_companion(
    change: FileChange, written: ConfigAnswer, tmp_path: Path, vehicle: Vehicle | None, why: str
) -> None:
    found = change.answer(vehicle, NOW)
    assert found is not None
    assert (found.written, found.restarts) == (True, False)
    assert why in found.text
    assert not allowed(tmp_path, written)


def test_the_leave_is_taken_back_where_the_vehicle_is_armed_meanwhile(
    change: FileChange, written: ConfigAnswer, tmp_path: Path
) -> None:
    change.answer(STANDS, NOW)
    assert allowed(tmp_path, written)
    change.watch(replace(STANDS, armed=True), NOW + 0.5)
    assert not allowed(tmp_path, written)


def test_no_leave_is_given_to_a_helper_that_was_too_late(
    change: FileChange, written: ConfigAnswer, tmp_path: Path
) -> None:
    leave(ConfigAnswer(written.id, written=True, text="done"), tmp_path / "answers")
    found = change.answer(STANDS, NOW)
    assert found is not None
    assert (found.restarts, found.text) == (False, "done; it took too long")
    assert not allowed(tmp_path, written)


def test_without_an_answer_the_request_is_taken_back_and_that_is_said(
    change: FileChange, tmp_path: Path
) -> None:
    change.ask({"camera.rate": 5.0}, SHA256, "x", STANDS, NOW)
    leave(ConfigAnswer("other", written=True, text=""), tmp_path / "answers")
    assert change.answer(STANDS, NOW + WITHIN - 0.1) is None
    assert (tmp_path / "run" / REQUEST).exists()
    found = change.answer(STANDS, NOW + WITHIN)
    assert found is not None
    assert not found.written
    assert "systemctl status anytraverse-config.path" in found.text
    assert not (tmp_path / "run" / REQUEST).exists()


def test_a_request_is_good_for_less_time_than_its_answer_is_waited_for(
    change: FileChange, tmp_path: Path
) -> None:
    change.ask({"camera.rate": 5.0}, SHA256, "x", STANDS, NOW)
    left = read_request(tmp_path / "run", os.getuid()).until - clock()
    assert 0.0 < left < WITHIN
    unit = (Path(__file__).parents[4] / "systemd/anytraverse-config.service").read_text()
    assert "\nTimeoutStartSec=18\n" in unit
    assert WITHIN > 18.0


def test_a_request_that_cannot_be_laid_down_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    change = FileChange(tmp_path / "file", tmp_path)
    assert "cannot be laid down" in change.ask({"camera.rate": 5.0}, SHA256, "x", STANDS, NOW)


def test_there_is_none_without_systemd(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("RUNTIME_DIRECTORY", raising=False)
    assert FileChange.of_service() is None
    monkeypatch.setenv("RUNTIME_DIRECTORY", "/run/anytraverse")
    assert FileChange.of_service() is not None
