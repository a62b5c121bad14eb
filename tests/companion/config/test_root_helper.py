"""Root's helper changes the file for a supervisor that it does not believe."""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from companion.config import root_helper
from companion.config.editing import Proposal, propose, write
from companion.config.request import (
    ANSWER,
    LEAVE,
    LEAVE_LASTS,
    REQUEST,
    ConfigAnswer,
    ConfigRequest,
    ConfigRequestError,
    clock,
    read_answer,
    read_request,
)
from companion.config.root_helper import answered, leave, may_restart

TEXT = '# mine\n[camera]\nsource = "v4l2:/dev/video0"\nrate = 10.0\n[vehicle]\nfile = ""\n'
USER = os.getuid()


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "etc" / "companion.toml"
    path.parent.mkdir()
    path.write_text(TEXT)
    return path


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    path = tmp_path / "run"
    path.mkdir()
    return path


def _lay(folder: Path, changes: dict[str, Any], before: str = TEXT, **others: Any) -> None:
    digest = hashlib.sha256(before.encode()).hexdigest()
    asked = {
        "id": "a1",
        "sha256": digest,
        "asked_from": "127.0.0.1",
        "changes": changes,
        "until": clock() + 5.0,
    }
    asked |= others
    (folder / REQUEST).write_text(json.dumps(asked))


def test_an_open_setting_is_changed_and_the_request_is_gone(file: Path, folder: Path) -> None:
    _lay(folder, {"camera.rate": 5.0})
    answer = answered(file, folder, USER)
    assert (answer.id, answer.written) == ("a1", True)
    assert file.read_text() == TEXT.replace("10.0", "5.0")
    assert file.with_name("companion.toml.1").read_text() == TEXT
    assert not list(folder.iterdir())


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"camera.source": "pipe:rm -rf /"}, "only in the shell"),
        ({"camera.rate": 5.0, "web.token": "0123456789abcdef"}, "only in the shell"),
        ({"call.policy": "hold"}, "only in the shell"),
        ({"link.more.x.url": "udpin:0.0.0.0:1"}, "only in the shell"),
        ({"camera.rate": 5000.0}, "from 0.5 to 60"),
        ({"camera.rat": 5.0}, "is not known"),
        ({"camera.rate": "x" * 1000}, "give a number"),
        ({}, "0 changes"),
        ({f"words.w{n}": 1.0 for n in range(65)}, "65 changes"),
    ],
)
def test_what_may_not_be_written_is_refused_wherever_it_was_asked_from(
    file: Path, folder: Path, changes: dict[str, Any], why: str
) -> None:
    _lay(folder, changes)
    answer = answered(file, folder, USER)
    assert not answer.written
    assert why in answer.text
    assert len(answer.text) <= 2000
    assert file.read_text() == TEXT
    assert list(file.parent.iterdir()) == [file]
    assert not list(folder.iterdir())


@pytest.fixture
def opened() -> Iterator[list[str]]:
    """The paths that are opened meanwhile."""
    paths: list[str] = []
    watching = True

    def hook(event: str, details: tuple[Any, ...]) -> None:
        if watching and event == "open":
            paths.append(str(details[0]))

    sys.addaudithook(hook)  # it stays, and is silent afterwards
    yield paths
    watching = False


def test_no_file_that_a_refused_request_names_is_opened(
    file: Path, folder: Path, tmp_path: Path, opened: list[str]
) -> None:
    secret = tmp_path / "secret"
    secret.write_text("of root")
    for key in ("camera.calibration", "vehicle.file", "link.signing_key"):
        _lay(folder, {key: str(secret)})
        opened.clear()
        assert answered(file, folder, USER).text == f"only in the shell, by `companion config set`: {key}"
        assert str(file) in opened
        assert str(secret) not in opened


def test_a_file_that_was_changed_meanwhile_stays(file: Path, folder: Path) -> None:
    _lay(folder, {"camera.rate": 5.0}, before=TEXT + "# older\n")
    answer = answered(file, folder, USER)
    assert not answer.written
    assert "changed meanwhile" in answer.text
    assert file.read_text() == TEXT


@pytest.mark.parametrize("left", [-0.1, 3600.0])
def test_a_request_of_which_nobody_waits_for_the_end_is_not_done(
    file: Path, folder: Path, left: float
) -> None:
    _lay(folder, {"camera.rate": 5.0}, until=clock() + left)
    assert "too long" in answered(file, folder, USER).text
    assert file.read_text() == TEXT


def test_a_check_that_takes_until_nobody_waits_leaves_the_file(
    file: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _lay(folder, {"camera.rate": 5.0})
    late = clock() + 5.1

    def slow(path: Path, changes: Mapping[str, object | None]) -> Proposal:
        monkeypatch.setattr(root_helper, "clock", lambda: late)
        return propose(path, changes)

    monkeypatch.setattr(root_helper, "propose", slow)
    assert "too long" in answered(file, folder, USER).text
    assert file.read_text() == TEXT


def test_a_file_that_is_written_too_late_does_not_start_the_companion_again(
    file: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _lay(folder, {"camera.rate": 5.0})
    late = clock() + 5.1

    def slow(path: Path, proposal: Proposal) -> Path:
        monkeypatch.setattr(root_helper, "clock", lambda: late)
        return write(path, proposal)

    monkeypatch.setattr(root_helper, "write", slow)
    answer = answered(file, folder, USER)
    assert (answer.written, answer.restarts) == (True, False)
    assert "5.0" in file.read_text()


class Grace:
    """Passes the helper's time by its own sleep; meanwhile things are done, each at its second."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *todo: tuple[float, Callable[[], object]]) -> None:
        self.now = self.began = clock()
        self.todo = list(todo)
        monkeypatch.setattr(root_helper, "clock", lambda: self.now)

    def sleep(self, seconds: float) -> None:
        self.now += seconds
        while self.todo and self.now - self.began >= self.todo[0][0]:
            self.todo.pop(0)[1]()


def test_the_companion_starts_again_by_a_leave_that_still_stands_after_the_grace(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, began = folder / LEAVE, clock()

    def give(request_id: str = "a1", left: float = LEAVE_LASTS, at: float = 0.5) -> Callable[[], object]:
        told = {"id": request_id, "until": began + at + left}
        return lambda: path.write_text(json.dumps(told))

    def restarts(*todo: tuple[float, Callable[[], object]], user: int = USER) -> bool:
        path.unlink(missing_ok=True)
        grace = Grace(monkeypatch, *todo)
        return may_restart("a1", folder, user, grace.sleep)

    renewed = (1.2, give(at=1.2))
    assert restarts((0.5, give()), renewed)
    assert not restarts((0.5, give())), "it is not renewed: the supervisor hangs"
    assert not restarts(), "no leave is given"
    assert not restarts((3.0, give())), "it comes too late"
    assert not restarts((0.5, give()), renewed, (1.3, path.unlink)), "the vehicle is armed in the grace"
    assert not restarts((0.5, give(left=3600.0))), "none is good for an hour"
    assert not restarts((0.5, give("b2"))), "it is for another request"
    assert not restarts((0.5, give()), user=USER + 1), "it is not the supervisor's"
    assert not restarts((0.5, lambda: path.write_bytes(b"[" * 9000)))


def test_a_request_of_another_user_is_not_done(file: Path, folder: Path) -> None:
    _lay(folder, {"camera.rate": 5.0})
    assert "not the supervisor's" in answered(file, folder, USER + 1).text
    assert file.read_text() == TEXT
    assert not list(folder.iterdir())


def test_what_is_no_file_of_the_supervisor_is_not_read(file: Path, folder: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    _lay(folder, {"camera.rate": 5.0})
    request = folder / REQUEST
    request.rename(other)

    request.symlink_to(other)
    assert not answered(file, folder, USER).written
    request.hardlink_to(other)
    assert not answered(file, folder, USER).written
    os.mkfifo(request)
    assert not answered(file, folder, USER).written
    (request / "x").mkdir(parents=True)
    assert not answered(file, folder, USER).written
    assert not answered(file, folder, USER).written  # nothing lies there
    request.write_bytes(other.read_bytes())
    request.chmod(0o666)
    assert "others may write" in answered(file, folder, USER).text
    request.write_bytes(b" " * 70_000)
    assert "larger than" in answered(file, folder, USER).text
    assert other.exists()
    assert file.read_text() == TEXT
    assert not list(folder.iterdir())


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=10,
)
_FORMS = st.fixed_dictionaries(
    {},
    optional={
        "id": _JSON | st.just("a1"),
        "sha256": _JSON | st.just(hashlib.sha256(TEXT.encode()).hexdigest()),
        "asked_from": _JSON | st.just("x"),
        "changes": _JSON | st.dictionaries(st.sampled_from(["camera.rate", "words", "words.x", ""]), _JSON),
        "until": _JSON | st.just(clock() + 5.0),
        "more": _JSON,
    },
)


@pytest.mark.slow
@given(st.binary(max_size=200) | st.builds(lambda form: json.dumps(form).encode(), _FORMS))
@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_rubbish_is_refused_and_never_half_done(file: Path, folder: Path, raw: bytes) -> None:
    file.write_text(TEXT)
    (folder / REQUEST).write_bytes(raw)
    answer = answered(file, folder, USER)
    assert answer.text.isprintable()
    if not answer.written:
        assert file.read_text() == TEXT
    assert not list(folder.iterdir())


def test_a_request_and_an_answer_read_back_as_they_were_written(folder: Path) -> None:
    _lay(folder, {"camera.rate": 5, "words": {"grass": 1.0}, "vocabulary": ["mud"], "camera.fps": None})
    request = read_request(folder, USER)
    assert isinstance(request, ConfigRequest)
    assert request.changes["words"] == {"grass": 1.0}
    with pytest.raises((ConfigRequestError, FileNotFoundError)):
        read_request(folder, USER)
    answer = ConfigAnswer("a1", written=True, text="done")
    assert read_answer(folder) is None
    leave(answer, folder)
    assert read_answer(folder) == answer
    (folder / ANSWER).write_bytes(b"{")
    assert read_answer(folder) is None
