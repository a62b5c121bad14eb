"""`companion run` in this process: from the configuration to what is left behind."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import cv2
import pytest

from anytraverse.errors import AnyTraverseError
from anytraverse.perception import Perceiver
from companion import readiness, run
from companion.config import Config, load_config
from companion.journal import Journal
from companion.link.rehearsal import Rehearsal
from companion.link.settings import LinkError
from companion.loading import load
from companion.restored import first_policy
from companion.wire.answers import Acknowledgement, AnswerMessage
from companion.wire.ids import TUNNEL_ACKNOWLEDGEMENT, TUNNEL_ANSWER, Motion, Policy, Result
from companion.wire.signing import SigningKey, Timestamps, refusal
from tests.anytraverse.conftest import Painted
from tests.companion.daemon.rig import picture

PATIENCE = 10.0


@pytest.fixture
def config(tmp_path: Path, radio: socket.socket, monkeypatch: pytest.MonkeyPatch) -> Config:
    """Ten frames a second of painted grass."""
    pictures = tmp_path / "frames"
    pictures.mkdir()
    for number in range(5):
        cv2.imwrite(str(pictures / f"{number}.png"), picture()[..., ::-1])
    path = tmp_path / "companion.toml"
    path.write_text(
        f"""
        [camera]
        source = "folder:{pictures}"
        loop = true
        [vehicle]
        file = ""
        [link]
        url = "udpout:127.0.0.1:{radio.getsockname()[1]}"
        [journal]
        folder = "{tmp_path / "state"}"
        [words]
        grass = 1.0
        rock = -1.0
        """
    )
    monkeypatch.setattr(readiness, "make_perceiver", lambda *_: Painted())
    return load_config(str(path))


def threads() -> set[str]:
    """Of a daemon, running."""
    return {thread.name for thread in threading.enumerate()} & {"camera", "eyes", "loading", "writer"}


def until(fits: Callable[[], bool]) -> Callable[[], bool]:
    """A stop that waits for something, but not for ever."""
    deadline = time.monotonic() + PATIENCE
    return lambda: fits() or time.monotonic() > deadline


def test_with_a_key_all_that_it_says_is_signed_and_the_key_stays_where_it_is(
    config: Config, tmp_path: Path, radio: socket.socket
) -> None:
    key, secret = tmp_path / "signing.key", bytes(range(100, 132))
    key.touch(0o600)
    key.write_bytes(secret)
    config = replace(config, link=replace(config.link, signing_key=str(key)))
    path = tmp_path / "state" / "status.json"
    radio.settimeout(0)
    heard: list[bytes] = []

    def told() -> bool:
        with suppress(BlockingIOError):
            heard.append(radio.recv(4096))
        return len(heard) >= 5 and path.is_file()

    assert run.main(config, until(told)) == 0
    assert {refusal(frame, SigningKey(secret), Timestamps(), None) for frame in heard} == {""}
    state = (tmp_path / "state" / "signing.state").read_bytes()
    for form in (secret, secret.hex().encode()):
        assert form not in state
        assert form not in path.read_bytes()


def test_a_key_that_others_may_read_ends_it_at_once(config: Config, tmp_path: Path) -> None:
    key = tmp_path / "signing.key"
    key.write_bytes(bytes(range(32)))
    key.chmod(0o644)
    with pytest.raises(LinkError, match="chmod 600"):
        run.main(replace(config, link=replace(config.link, signing_key=str(key))), lambda: True)


def test_it_judges_tells_and_leaves_nothing_running(
    config: Config, tmp_path: Path, radio: socket.socket
) -> None:
    path = tmp_path / "state" / "status.json"

    def judged() -> bool:
        return path.is_file() and json.loads(path.read_text())["frames"] >= 5

    assert run.main(config, until(judged)) == 0
    status = json.loads(path.read_text())
    assert (status["state"], status["words"]) == ("ok", "grass: 1; rock: -1")
    assert len(status["recent"]) == status["frames"]
    assert radio.recv(300)[0] == 0xFD
    assert threads() == set()
    Journal(tmp_path / "state").close()


def test_a_perceiver_that_cannot_load_is_told_and_the_journal_given_back(
    config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(readiness, "make_perceiver", lambda *_: 1 / 0)
    with pytest.raises(AnyTraverseError, match="ZeroDivisionError"):
        run.main(config, until(lambda: False))
    Journal(tmp_path / "state").close()


def test_an_error_after_the_camera_was_opened_leaves_nothing_running(
    config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "SettingsDesk", lambda *_, **__: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        run.main(config, until(lambda: False))
    assert threads() == set()
    Journal(tmp_path / "state").close()


def test_an_error_of_the_supervision_ends_it_with_a_farewell(
    config: Config, radio: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("companion.calls.machine.OperatorCalls.tick", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        run.main(config, until(lambda: False))
    assert threads() == set()
    heard = b""
    try:
        while True:
            heard += radio.recv(300)
    except TimeoutError:
        pass
    assert b"Companion STOPS" in heard


def test_a_signal_while_loading_ends_it(config: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    released = threading.Event()

    def slow(*_: object) -> Perceiver:
        released.wait(PATIENCE)
        return Painted()

    monkeypatch.setattr(readiness, "make_perceiver", slow)
    started = time.monotonic()
    assert run.main(config, lambda: time.monotonic() - started > 0.2) == 0
    assert time.monotonic() - started < 2.0
    released.set()


def test_a_supervision_that_makes_no_sense_is_left_aside(config: Config, tmp_path: Path) -> None:
    journal = Journal(tmp_path / "state")
    journal.save_supervision({"call": "?", "hold": 7, "last_id": "x", "frame_id": -3, "replies": [1, "two"]})
    journal.close()
    path = tmp_path / "state" / "status.json"
    assert run.main(config, until(path.is_file)) == 0
    assert json.loads(path.read_text())["current_id"] == 0


def test_answers_while_loading_are_busy_so_that_they_are_sent_again() -> None:
    from pymavlink.dialects.v20 import development as mavlink

    stage = Rehearsal()
    stage.run(0.5)
    payload = AnswerMessage(5, 3, Motion.GO).pack()
    padded = list(payload.ljust(128, b"\0"))

    def slow() -> Perceiver:
        stage.send(mavlink.MAVLink_tunnel_message(1, 191, TUNNEL_ANSWER, len(payload), padded))
        time.sleep(0.3)
        return Painted()

    assert isinstance(load(slow, stage.link, lambda: False), Painted)
    stage.collect(stage.now)
    (told,) = [Acknowledgement.unpack(payload) for payload in stage.tunnels(TUNNEL_ACKNOWLEDGEMENT)]
    assert (told.transaction, told.result, told.text) == (5, Result.BUSY, "starting, send it again")


@pytest.mark.parametrize(
    ("saved", "policy"),
    [({}, Policy.HOLD), ({"policy": {"off_by": "255/190"}}, Policy.OFF)],
    ids=["as configured", "as it was switched off"],
)
def test_while_it_starts_it_tells_the_policy_that_will_be_in_force(
    config: Config, saved: dict[str, object], policy: Policy
) -> None:
    assert first_policy(replace(config, call=replace(config.call, policy="hold")), saved) is policy
