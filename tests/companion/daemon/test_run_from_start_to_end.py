"""`companion run` in this process: from the configuration to what is left behind."""

from __future__ import annotations

import json
import os
import re
import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from anytraverse.errors import AnyTraverseError
from anytraverse.memory import first_memory
from anytraverse.preferences import Preferences
from bench.processes import children
from companion import run
from companion.config import Config, load_config
from companion.config.link_settings import LinkSettingError
from companion.daemon.settings.runtime import restored_policy
from companion.daemon.startup import load
from companion.link.answer_store import AnswerStore
from companion.sim.loopback_link import LoopbackLink
from companion.storage import Batch, Journal
from companion.storage.batch import as_json
from companion.storage.writer import SLOW
from companion.system.service_manager import ServiceManager
from companion.tasks import VISION
from companion.vision.client import MAX_JOBS
from companion.wire.answers import Acknowledgement, Answer
from companion.wire.ids import TUNNEL_ACKNOWLEDGEMENT, TUNNEL_ANSWER, Motion, Policy, Result
from companion.wire.signing import SigningKey, Timestamps, refusal
from tests.companion.daemon.rig import picture
from tests.companion.processes import heard, painted_config
from tests.companion.vision import painted
from tests.companion.vision.played import loading

PATIENCE = 10.0


@pytest.fixture
def config(tmp_path: Path, radio: socket.socket) -> Config:
    """Ten frames a second of painted grass."""
    path = painted_config(tmp_path, radio.getsockname()[1], [picture()] * 5, more="rock = -1.0")
    painted.register()
    return load_config(str(path))


Left = Callable[[], tuple[set[int], set[str]]]


@pytest.fixture
def left() -> Left:
    """Returns the processes and threads that run and did not run when the test began."""
    before = children(os.getpid()).keys()
    return lambda: (children(os.getpid()).keys() - before, threads())


def start(config: Config, stop: Callable[[], bool]) -> int:
    """The daemon, with a vision process that sees what is painted."""
    return run.main(config, stop, vision=painted.COMMAND)


def threads() -> set[str]:
    """Of a daemon, running."""
    return {thread.name for thread in threading.enumerate()} & {"writer"}


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

    assert start(config, until(told)) == 0
    assert {refusal(frame, SigningKey(secret), Timestamps(), None) for frame in heard} == {""}
    state = (tmp_path / "state" / "signing.state").read_bytes()
    for form in (secret, secret.hex().encode()):
        assert form not in state
        assert form not in path.read_bytes()


def test_a_key_that_others_may_read_ends_it_at_once(config: Config, tmp_path: Path) -> None:
    key = tmp_path / "signing.key"
    key.write_bytes(bytes(range(32)))
    key.chmod(0o644)
    with pytest.raises(LinkSettingError, match="chmod 600"):
        run.main(replace(config, link=replace(config.link, signing_key=str(key))), lambda: True)


def test_the_log_says_when_it_is_ready_when_the_camera_delivers_and_that_it_stopped(
    config: Config, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    pictures, hidden = tmp_path / "frames", tmp_path / "later"
    pictures.rename(hidden)
    caplog.set_level("INFO")

    def back_after_a_fault() -> bool:
        # On a busy computer the missing frame may be noticed before the camera's failure is told.
        told = re.search(r"fault: (camera failed|no fresh frame): folder", caplog.text)
        if told and hidden.is_dir():
            assert "ready: policy report" in caplog.text
            assert "camera delivers" not in caplog.text
            hidden.rename(pictures)
        return "camera delivers" in caplog.text

    assert start(config, until(back_after_a_fault)) == 0
    assert "camera delivers" in caplog.text
    assert caplog.messages[-1] == "told to stop, and stopped"


def test_its_parameters_are_those_of_before_the_restart_from_the_first_moment(
    config: Config, tmp_path: Path, radio: socket.socket
) -> None:
    journal = Journal(tmp_path / "state")
    words = config.preferences.merged(Preferences.of({"rock": -0.25}, 3))
    journal.commit(Batch(memory=replace(first_memory("painted-1", config.preferences), preferences=words)))
    settings = {"model": "painted-1", "values": {"AT_THR_ROI": [0.55, 0.3], "AT_SUM_HZ": [2.0, 1.0]}}
    journal.commit(Batch(state=as_json({"settings": settings})))
    journal.close()
    config = replace(config, perceiver=replace(config.perceiver, name="painted:slow"))
    parser, ground = mavlink.MAVLink(None), mavlink.MAVLink(None, 255, 190)
    radio.settimeout(0)
    heard: dict[str, float] = {}
    asked: list[bool] = []

    def listed() -> bool:
        with suppress(BlockingIOError):
            while True:
                datagram, companion = radio.recvfrom(4096)
                for message in parser.parse_buffer(datagram) or []:
                    if message.get_type() == "PARAM_VALUE":
                        heard[message.param_id] = round(message.param_value, 4)
                if not asked:
                    asked.append(True)
                    radio.sendto(mavlink.MAVLink_param_request_list_message(1, 191).pack(ground), companion)
        return {"AT_W_ROCK", "AT_THR_ROI", "AT_SUM_HZ"} <= set(heard)

    assert start(config, until(listed)) == 0
    assert (heard["AT_W_ROCK"], heard["AT_THR_ROI"], heard["AT_SUM_HZ"]) == (-0.25, 0.55, 2.0)


def test_it_judges_tells_and_leaves_nothing_running(
    left: Left, config: Config, tmp_path: Path, radio: socket.socket
) -> None:
    path = tmp_path / "state" / "status.json"

    def judged() -> bool:
        return path.is_file() and json.loads(path.read_text())["frames"] >= 5

    assert start(config, until(judged)) == 0
    status = json.loads(path.read_text())
    assert (status["state"], status["words"]) == ("ok", "grass: 1; rock: -1")
    assert len(status["recent"]) == status["frames"]
    assert radio.recv(300)[0] == 0xFD
    assert left() == (set(), set())
    Journal(tmp_path / "state").close()


@pytest.mark.parametrize("signed", [False, True], ids=["unsigned", "signed"])
def test_it_ends_within_its_limit_though_the_disk_hangs(
    config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, signed: bool
) -> None:
    path, hangs, released = tmp_path / "state" / "status.json", threading.Event(), threading.Event()
    stuck = list[str]()
    if signed:
        key = tmp_path / "signing.key"
        key.touch(0o600)
        key.write_bytes(bytes(range(100, 132)))
        config = replace(config, link=replace(config.link, signing_key=str(key)))

    def hanging(function: Callable[..., Any]) -> Callable[..., Any]:
        def wait(*arguments: Any, **named: Any) -> Any:
            if hangs.is_set():
                stuck.append(threading.current_thread().name)
                assert released.wait(PATIENCE)
            return function(*arguments, **named)

        return wait

    for name in ("open", "replace", "fsync", "fdatasync", "pwrite"):
        monkeypatch.setattr(os, name, hanging(getattr(os, name)))
    monkeypatch.setattr(Path, "open", hanging(Path.open))
    monkeypatch.setattr(Journal, "commit", hanging(Journal.commit))
    told: list[float] = []

    def judged() -> bool:
        if path.is_file() and json.loads(path.read_text())["frames"] >= 5:
            hangs.set()
            told.append(time.monotonic())
        return bool(told)

    try:
        assert start(config, until(judged)) == 0
        assert time.monotonic() - told[0] < 5.0
        assert "MainThread" not in stuck
        assert "writer" in stuck
    finally:
        released.set()
        for thread in threading.enumerate():
            if thread.name in ("writer", "signing-state"):
                thread.join(PATIENCE)


def test_the_link_waits_for_an_answer_as_long_as_its_perceiver_may_take(
    config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[float] = []
    monkeypatch.setattr(AnswerStore, "set_undecided_for", lambda _, seconds: told.append(seconds))
    assert start(config, until((tmp_path / "state" / "status.json").is_file)) == 0
    assert told[0] > (MAX_JOBS + 1) * VISION.silent_for + SLOW


def test_a_perceiver_that_cannot_load_is_told_and_the_journal_given_back(
    left: Left, config: Config, tmp_path: Path
) -> None:
    config = replace(config, perceiver=replace(config.perceiver, name="painted:broken"))
    with pytest.raises(AnyTraverseError, match="paint them again"):
        start(config, until(lambda: False))
    assert left() == (set(), set())
    Journal(tmp_path / "state").close()


@pytest.mark.parametrize(("order", "how"), [("die", "SIGSEGV"), ("exit", "exit code 3")])
def test_a_vision_process_that_dies_is_started_again_and_judges_on(
    left: Left, config: Config, tmp_path: Path, caplog: pytest.LogCaptureFixture, order: str, how: str
) -> None:
    orders, path = tmp_path / "orders", tmp_path / "state" / "status.json"
    config = replace(config, perceiver=replace(config.perceiver, name=f"painted:{orders}"))
    given, frames = False, 0

    def judges_again() -> bool:
        nonlocal given, frames
        told = json.loads(path.read_text()) if path.is_file() else {"frames": 0}
        if not given and told["frames"] >= 3:
            orders.write_text(order)
            given = True
        elif given and how in caplog.text and orders.exists():
            orders.unlink()
            frames = told["frames"]
        return given and not orders.exists() and told["frames"] >= frames + 3 and told["state"] == "ok"

    assert start(config, until(judges_again)) == 0
    assert f"the vision process ended: {how}" in caplog.text
    assert json.loads(path.read_text())["frames"] >= frames + 3
    assert left() == (set(), set())


def test_an_error_after_the_vision_process_was_started_leaves_nothing_running(
    left: Left, config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("companion.daemon.composition.SettingsService", lambda *_, **__: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        start(config, until(lambda: False))
    assert left() == (set(), set())
    Journal(tmp_path / "state").close()


def test_an_error_of_the_supervision_ends_it_with_a_farewell(
    left: Left, config: Config, radio: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("companion.calls.machine.OperatorCalls.tick", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        start(config, until(lambda: False))
    assert left() == (set(), set())
    assert b"Companion STOPS" in heard(radio)


def test_a_signal_while_loading_ends_it_and_the_vision_process(left: Left, config: Config) -> None:
    config = replace(config, perceiver=replace(config.perceiver, name="painted:slow"))
    started = time.monotonic()
    assert start(config, lambda: time.monotonic() - started > 0.5) == 0
    assert time.monotonic() - started < 3.0
    assert left() == (set(), set())


def test_the_service_manager_is_told_from_the_start_to_the_end(config: Config, tmp_path: Path) -> None:
    address, path = tmp_path / "notify", tmp_path / "state" / "status.json"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(str(address))
        systemd.settimeout(0)
        environment = {
            "NOTIFY_SOCKET": str(address),
            "WATCHDOG_USEC": "200000",
            "RUNTIME_DIRECTORY": str(tmp_path),
        }
        heard: list[str] = []

        def watched() -> bool:
            with suppress(BlockingIOError):
                heard.append(systemd.recv(4096).decode())
            return heard.count("WATCHDOG=1") >= 5 and "STATUS=ok, policy report" in heard

        service = ServiceManager(environment)
        service.pause(lambda: True)
        assert (tmp_path / "failures").read_text() == "1"
        assert run.main(config, until(watched), painted.COMMAND, service) == 0
        with suppress(BlockingIOError):
            while True:
                heard.append(systemd.recv(4096).decode())
    assert path.is_file()
    assert heard[0] == "STATUS=starting: the perceiver is loading"
    assert heard.index("EXTEND_TIMEOUT_USEC=30000000") < heard.index("READY=1") < heard.index("WATCHDOG=1")
    assert heard[-1].startswith("STOPPING=1")
    assert (tmp_path / "failures").read_text() == "0"


def test_a_sensor_that_hangs_does_not_delay_the_writer(
    config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    released = threading.Event()
    monkeypatch.setattr("companion.system.computer.Computer.measure", lambda _: released.wait(PATIENCE))
    path, written = tmp_path / "state" / "status.json", set[int]()

    def written_thrice() -> bool:
        with suppress(OSError):
            written.add(path.stat().st_mtime_ns)
        return len(written) >= 3

    assert run.main(config, until(written_thrice), painted.COMMAND) == 0
    released.set()
    assert len(written) >= 3
    assert threads() == set()


def test_an_end_that_nobody_asked_for_counts_as_a_failure(
    config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("companion.calls.machine.OperatorCalls.tick", lambda *_: 1 / 0)
    service = ServiceManager({"RUNTIME_DIRECTORY": str(tmp_path)})
    service.pause(lambda: True)
    with pytest.raises(ZeroDivisionError):
        run.main(config, until(lambda: False), painted.COMMAND, service)
    assert (tmp_path / "failures").read_text() == "1"


def test_a_supervision_that_makes_no_sense_is_left_aside(config: Config, tmp_path: Path) -> None:
    journal = Journal(tmp_path / "state")
    journal.commit(
        Batch(state=as_json({"call": "?", "hold": 7, "last_id": "x", "frame_id": -3, "replies": [1, "two"]}))
    )
    journal.close()
    path = tmp_path / "state" / "status.json"
    assert start(config, until(path.is_file)) == 0
    assert json.loads(path.read_text())["current_id"] == 0


def test_answers_while_loading_are_busy_so_that_they_are_sent_again() -> None:
    from pymavlink.dialects.v20 import development as mavlink

    stage = LoopbackLink()
    stage.run(0.5)
    payload = Answer(3, Motion.GO, transaction=5).pack()
    padded = list(payload.ljust(128, b"\0"))

    stage.send(mavlink.MAVLink_tunnel_message(1, 191, TUNNEL_ANSWER, len(payload), padded))
    with loading() as (vision, child):
        turns = iter(range(10))

        def stop() -> bool:
            if next(turns) > 2:
                child.work()
            return False

        ready = load(vision, stage.link, stop, ServiceManager({}))
    assert ready is not None
    assert ready.model.id == "painted-1"
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
    configured = replace(config, call=replace(config.call, policy="hold"))
    assert restored_policy(configured, saved.get("policy"), 0.0).in_force is policy
