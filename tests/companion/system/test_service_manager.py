"""What systemd hears, on a socket like its own, and how long repeated failures make a start wait."""

from __future__ import annotations

import faulthandler
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from companion.system.service_manager import LONGEST_PAUSE, STEADY_AFTER, ServiceManager


class Systemd:
    """The receiving end. `heard` empties it."""

    def __init__(self, address: str) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(address)
        self.socket.settimeout(0)

    def heard(self) -> list[str]:
        lines: list[str] = []
        try:
            while True:
                lines += self.socket.recv(4096).decode().splitlines()
        except BlockingIOError:
            return lines


@pytest.fixture(params=["path", "abstract"])
def systemd(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Systemd]:
    name = str(tmp_path / "notify")
    shown = name if request.param == "path" else f"@{name}"
    monkeypatch.setenv("NOTIFY_SOCKET", shown)
    end = Systemd(shown.replace("@", "\0"))
    yield end
    end.socket.close()


def test_the_watchdog_is_fed_four_times_in_its_period_and_only_when_asked(
    systemd: Systemd, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WATCHDOG_USEC", "2000000")
    service = ServiceManager()
    service.ready(100.0)
    assert systemd.heard() == ["READY=1"]
    for turn in range(200):
        service.alive(100.0 + 0.02 * turn)
    assert systemd.heard() == ["WATCHDOG=1"] * 8


@pytest.mark.parametrize(
    "environment",
    [{}, {"WATCHDOG_USEC": "0"}, {"WATCHDOG_USEC": "x"}, {"WATCHDOG_USEC": "2000000", "WATCHDOG_PID": "1"}],
)
def test_without_a_watchdog_of_ours_none_is_fed(systemd: Systemd, environment: dict[str, str]) -> None:
    service = ServiceManager({**os.environ, **environment})
    service.alive(100.0)
    assert systemd.heard() == []


def run_alone(code: str) -> subprocess.CompletedProcess[str]:
    """Run code in a process that nobody but itself watches, for a fifth of a second."""
    head = "import time\nfrom companion.system.service_manager import ServiceManager as Manager\n"
    head += "service = Manager()\n"
    environment = {name: value for name, value in os.environ.items() if name != "NOTIFY_SOCKET"}
    return subprocess.run(
        [sys.executable, "-c", head + code],
        env={**environment, "WATCHDOG_USEC": "200000"},
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
    )


def test_where_nobody_watches_it_a_process_that_hangs_says_where_and_ends() -> None:
    done = run_alone("service.ready(time.monotonic())\ntime.sleep(30)")
    assert done.returncode == 1
    assert "Timeout (0:00:00.200000)!" in done.stderr
    assert 'File "<string>", line 5' in done.stderr


def test_it_may_start_and_end_for_as_long_as_it_needs() -> None:
    done = run_alone(
        "time.sleep(0.4)\nservice.ready(0.0)\nservice.stopping()\ntime.sleep(0.4)\nprint('ended')"
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "ended\n", "")


def test_each_sign_of_life_gives_it_the_whole_period_again(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[float] = []
    monkeypatch.setattr(faulthandler, "dump_traceback_later", lambda seconds, **_: given.append(seconds))
    service = ServiceManager({"WATCHDOG_USEC": "2000000"})
    service.ready(100.0)
    for turn in range(200):
        service.alive(100.0 + 0.02 * turn)
    assert given == [2.0] * 9


def test_with_systemd_it_does_not_watch_itself(systemd: Systemd, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(faulthandler, "dump_traceback_later", None)
    monkeypatch.setenv("WATCHDOG_USEC", "2000000")
    service = ServiceManager()
    service.ready(100.0)
    service.alive(101.0)
    assert systemd.heard() == ["READY=1", "WATCHDOG=1"]


def test_a_long_start_asks_for_time_once_a_second(systemd: Systemd) -> None:
    service = ServiceManager()
    for turn in range(150):
        service.starting(0.02 * turn)
    heard = systemd.heard()
    assert heard.count("EXTEND_TIMEOUT_USEC=30000000") == 3
    assert [line for line in heard if line.startswith("STATUS=")] == [
        "STATUS=starting: the perceiver is loading"
    ]


def test_an_orderly_end_may_take_longer_than_the_watchdog(systemd: Systemd) -> None:
    ServiceManager().stopping()
    assert systemd.heard() == ["STOPPING=1", "WATCHDOG=1", "WATCHDOG_USEC=15000000"]


@pytest.mark.usefixtures("systemd")
def test_a_socket_that_nobody_reads_blocks_nothing_and_is_logged_once(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("WATCHDOG_USEC", "2000000")
    service, begun = ServiceManager(), time.monotonic()
    for second in range(5000):
        service.alive(float(second))
    assert time.monotonic() - begun < 5.0
    assert len(caplog.messages) == 1
    assert "systemd does not take WATCHDOG=1" in caplog.text


def test_that_it_is_ready_is_said_again_where_systemd_did_not_take_it(
    systemd: Systemd, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WATCHDOG_USEC", "2000000")
    service = ServiceManager()
    for second in range(1000):  # more than wait for a reader
        service.status(str(second))
    service.ready(0.0)
    assert "READY=1" not in systemd.heard()
    service.alive(0.0)
    service.alive(1.0)
    assert systemd.heard() == ["READY=1", "WATCHDOG=1", "WATCHDOG=1"]


@pytest.mark.parametrize("address", ["", "vsock:2:1", "/nowhere/at/all"])
def test_without_a_socket_that_can_be_reached_it_says_nothing(address: str) -> None:
    service = ServiceManager({"NOTIFY_SOCKET": address, "WATCHDOG_USEC": "1000000"})
    service.starting(0.0)
    service.ready(0.0)
    service.alive(0.0)
    service.stopping()


@pytest.fixture
def slept(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """How long each sleep was; none takes time."""
    sleeps: list[float] = []
    monkeypatch.setattr(time, "monotonic", lambda: 0.1 * len(sleeps))
    monkeypatch.setattr(time, "sleep", sleeps.append)
    return sleeps


def pauses(folder: Path, slept: list[float], starts: int) -> list[int]:
    """The whole seconds that each of several starts waits, all in new processes that die at once."""
    found: list[int] = []
    for _ in range(starts):
        before = len(slept)
        ServiceManager({"RUNTIME_DIRECTORY": str(folder)}).pause(lambda: False)
        found.append(round(sum(slept[before:])))
    return found


def test_the_pause_rises_to_a_minute_and_stays_there(tmp_path: Path, slept: list[float]) -> None:
    assert pauses(tmp_path, slept, 10) == [0, 0, 2, 4, 8, 16, 32, 59, 59, 59]
    assert LONGEST_PAUSE == 59


def steady(service: ServiceManager) -> None:
    service.ready(0.0)
    service.alive(STEADY_AFTER + 0.01)


@pytest.mark.parametrize("clean", [steady, ServiceManager.stopping], ids=["steady", "stopped"])
def test_a_steady_run_and_an_orderly_end_clear_the_failures(
    tmp_path: Path, slept: list[float], clean: Callable[[ServiceManager], None]
) -> None:
    pauses(tmp_path, slept, 6)
    clean(ServiceManager({"RUNTIME_DIRECTORY": str(tmp_path)}))
    assert pauses(tmp_path, slept, 3) == [0, 0, 2]


def test_a_run_that_dies_before_it_was_steady_clears_nothing(tmp_path: Path, slept: list[float]) -> None:
    pauses(tmp_path, slept, 3)
    service = ServiceManager({"RUNTIME_DIRECTORY": str(tmp_path)})
    service.ready(0.0)
    service.alive(STEADY_AFTER - 0.01)
    assert pauses(tmp_path, slept, 1) == [4]


def test_a_stop_ends_the_pause(tmp_path: Path, slept: list[float]) -> None:
    (tmp_path / "failures").write_text("6")
    ServiceManager({"RUNTIME_DIRECTORY": str(tmp_path)}).pause(lambda: len(slept) >= 3)
    assert len(slept) == 3


@pytest.mark.usefixtures("slept")
def test_systemd_hears_of_the_pause_and_grants_the_time(systemd: Systemd, tmp_path: Path) -> None:
    (tmp_path / "failures").write_text("7")
    ServiceManager({**os.environ, "RUNTIME_DIRECTORY": f"{tmp_path}:/run/other"}).pause(lambda: False)
    assert systemd.heard() == [
        "EXTEND_TIMEOUT_USEC=89000000",
        "STATUS=failed 7 times in a row: waits 59 s before it starts",
    ]


@given(content=st.binary(max_size=20))
@example(content=b"1025")
@example(content=b"999999")
def test_no_content_of_the_counter_stops_a_start(
    content: bytes, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("run")
    (folder / "failures").write_bytes(content)
    ServiceManager({"RUNTIME_DIRECTORY": str(folder)}).pause(lambda: True)
    assert 1 <= int((folder / "failures").read_text()) <= 1_000_000


def test_a_counter_that_cannot_be_written_is_said_and_stops_no_start(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    ServiceManager({"RUNTIME_DIRECTORY": str(tmp_path / "missing")}).pause(lambda: True)
    assert "restarts are not counted" in caplog.text
