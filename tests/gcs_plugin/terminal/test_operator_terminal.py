"""The terminal operator as a real process, over UDP, against a tiny rover."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from anytraverse.operations import SetWord, Tap
from companion.wire import ids
from companion.wire.call_report import CallReport

DEADLINE_S = 20.0


class Air:
    """A thread that lets a tiny rover speak ten times a second to whoever speaks to its port."""

    def __init__(self, rover: Any) -> None:
        self.rover = rover
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.02)
        self.link = f"udpout:127.0.0.1:{self.socket.getsockname()[1]}"
        self.peer: Any = None
        self.heard_ground = threading.Event()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def close(self) -> None:
        self._over.set()
        self._thread.join(DEADLINE_S)
        self.socket.close()

    def _run(self) -> None:
        speak_at = 0.0
        while not self._over.is_set():
            try:
                data, self.peer = self.socket.recvfrom(4096)
                replies = self.rover.hear(data)
                if self.rover.heard_ground:
                    self.heard_ground.set()
            except (TimeoutError, ConnectionError):
                replies = []
            if time.monotonic() >= speak_at:
                speak_at = time.monotonic() + 0.1
                replies += self.rover.speak()
            if self.peer is not None:
                for frame in replies:
                    self.socket.sendto(frame, self.peer)


class Operator:
    """The console program, its output read line by line against a deadline."""

    def __init__(self, *arguments: str) -> None:
        environment = {key: value for key, value in os.environ.items() if not key.startswith("MAVLINK")}
        self.process = subprocess.Popen(
            [sys.executable, "-m", "gcs_plugin.terminal.main", *arguments],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment,
        )  # fmt: skip
        self.lines: list[str] = []
        self._grown = threading.Condition()
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            with self._grown:
                self.lines.append(line.rstrip("\n"))
                self._grown.notify_all()

    def until(self, wanted: Callable[[str], bool]) -> str:
        def found() -> str | None:
            return next((line for line in self.lines if wanted(line)), None)

        with self._grown:
            assert self._grown.wait_for(found, DEADLINE_S), self.lines
            return str(found())

    def event(self, name: str, **fields: Any) -> dict[str, Any]:
        def fits(line: str) -> bool:
            told = json.loads(line)
            return told["event"] == name and all(told.get(key) == value for key, value in fields.items())

        told: dict[str, Any] = json.loads(self.until(fits))
        return told

    def type(self, line: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def end(self) -> int:
        """Close its input and wait."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        code = self.process.wait(DEADLINE_S)
        self._reader.join(DEADLINE_S)
        return code

    def close(self) -> None:
        self.process.kill()
        self.process.wait(DEADLINE_S)
        self._reader.join(DEADLINE_S)
        for stream in (self.process.stdin, self.process.stdout, self.process.stderr):
            assert stream is not None
            stream.close()


@pytest.fixture
def start() -> Iterator[Callable[..., Operator]]:
    started: list[Operator] = []

    def starting(*arguments: str) -> Operator:
        started.append(Operator(*arguments))
        return started[-1]

    yield starting
    for operator in started:
        operator.close()


@pytest.fixture
def fly(tiny_rover: Callable[..., Any]) -> Iterator[Callable[..., Air]]:
    airs: list[Air] = []

    def flying(call: CallReport | None = None) -> Air:
        airs.append(Air(tiny_rover(1, call)))
        return airs[-1]

    yield flying
    for air in airs:
        air.close()


def test_a_typed_tap_reaches_the_rover_and_the_end_has_the_figures(
    start: Callable[..., Operator], fly: Callable[..., Air], thing_call: CallReport
) -> None:
    air = fly(thing_call)
    operator = start("--connect", air.link, "--events")
    call = operator.event("call")
    assert (call["id"], call["reasons"], call["holding"]) == (7, ["unknown_object"], True)
    operator.type("7 tap drum -1 go")
    if "repeat it" in operator.until(lambda line: '"ack"' in line or "repeat it" in line):
        operator.type("7 tap drum -1 go")  # the rover's words were not read yet
    assert operator.event("ack")["result"] == "applied"
    assert operator.event("closed")["outcome"] == "answered"
    assert operator.end() == 0
    end = json.loads(operator.lines[-1])
    assert (end["event"], end["answers_sent"], end["answers_acknowledged"]) == ("end", 1, 1)
    assert end["calls_by_reason"] == {"unknown_object": 1}
    assert end["closed_by_outcome"] == {"answered": 1}
    assert end["latency_ms"] == {"p50": 120, "max": 120}
    assert end["summaries_lost"] == 0
    assert end["bytes_from_companion"] > 0
    assert air.rover.applied == [(7, ids.Motion.GO, (Tap(4711, (0.41, 0.55, 0.6, 0.81), "drum", -1.0),))]


def test_an_operator_without_a_key_is_told_that_the_rover_will_not_believe_it(
    start: Callable[..., Operator], fly: Callable[..., Air]
) -> None:
    air = fly()
    air.rover.companion.sign()
    operator = start("--connect", air.link)
    assert "rover 1" in operator.until(lambda line: "--signing-key" in line)


def test_a_script_answers_without_anyone_typing(
    start: Callable[..., Operator], fly: Callable[..., Air], thing_call: CallReport, tmp_path: Path
) -> None:
    script = tmp_path / "answers.json"
    script.write_text(json.dumps([{"reasons": ["unknown_object"], "answer": "bush: -1, go", "after": 0.2}]))
    air = fly(thing_call)
    operator = start("--connect", air.link, "--events", "--script", str(script))
    assert operator.event("typed")["line"] == "rover 1 7 bush: -1, go"
    operator.event("closed", id=7)
    assert air.rover.applied == [(7, ids.Motion.GO, (SetWord("bush", -1.0),))]


def test_a_person_reads_why_it_calls_and_what_fits(
    start: Callable[..., Operator], fly: Callable[..., Air], thing_call: CallReport
) -> None:
    operator = start("--connect", fly(thing_call).link)
    headline = operator.until(lambda line: "C7" in line)
    assert "unknown thing ahead, 38% unexplained, most in the middle (71%) [vehicle held" in headline
    assert "tap THING -1 go" in operator.until(lambda line: "answer" in line)
    operator.type("status")
    assert "AUTO armed" in operator.until(lambda line: "rover 1: heard" in line)
    operator.type("nonsense")
    assert "`bush: -1`" in operator.until(lambda line: "? " in line)
    operator.type("quit")
    assert operator.process.wait(DEADLINE_S) == 0
    assert "\033" not in "".join(operator.lines)


def test_a_person_reads_text_and_a_file_gets_the_events(
    start: Callable[..., Operator], fly: Callable[..., Air], thing_call: CallReport, tmp_path: Path
) -> None:
    log = tmp_path / "log.jsonl"
    operator = start("--connect", fly(thing_call).link, "--log", str(log))
    operator.until(lambda line: "C7 unknown thing" in line)
    operator.type("quit")
    assert operator.process.wait(DEADLINE_S) == 0
    events = [json.loads(line)["event"] for line in log.read_text(encoding="utf-8").splitlines()]
    assert (events[0], events[-1], "call" in events) == ("started", "end", True)


def test_a_log_that_cannot_be_written_costs_the_log_and_no_answer(
    start: Callable[..., Operator], fly: Callable[..., Air], thing_call: CallReport
) -> None:
    air = fly(thing_call)
    operator = start("--connect", air.link, "--events", "--log", "/dev/full")
    assert operator.event("problem")["text"].startswith("the log ends here")
    operator.event("call")
    operator.type("7 go")
    operator.event("ack")
    assert operator.end() == 0
    assert sum('"problem"' in line for line in operator.lines) == 1


def test_an_answer_that_quit_leaves_behind_is_said_to_be_given_up(
    start: Callable[..., Operator], fly: Callable[..., Air], thing_call: CallReport
) -> None:
    operator = start("--connect", fly(thing_call).link, "--events")
    operator.event("call")
    operator.type("7 go\nquit")
    assert operator.process.wait(DEADLINE_S) == 0
    assert operator.event("problem")["text"] == "answer to 7 is not acknowledged, and given up"


@pytest.mark.slow
def test_a_link_that_is_refused_is_told_once_and_tried_again(start: Callable[..., Operator]) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # bound and not listening: connections are refused
        link = f"tcp:127.0.0.1:{taken.getsockname()[1]}"
        operator = start("--connect", link, "--events", "--quit-after", "1.5")
        assert operator.process.wait(DEADLINE_S) == 0
    problems = [json.loads(line)["text"] for line in operator.lines if '"problem"' in line]
    assert len(problems) == 1
    assert problems[0].startswith(f"{link}: ")
    assert problems[0].endswith("refused; trying again")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_it_with_the_figures(start: Callable[..., Operator], number: signal.Signals) -> None:
    operator = start("--connect", "udpin:127.0.0.1:0", "--events")
    operator.event("started")
    operator.process.send_signal(number)
    assert operator.process.wait(DEADLINE_S) == 0
    assert operator.event("end")["calls"] == 0


@pytest.mark.slow
def test_a_rover_that_speaks_first_is_heard_on_a_port_that_listens(
    start: Callable[..., Operator], fly: Callable[..., Air]
) -> None:
    operator = start("--connect", "udpin:127.0.0.1:0", "--events")
    air = fly()
    air.peer = ("127.0.0.1", int(operator.event("started")["link"].rpartition(":")[2]))
    assert operator.event("vehicle") == operator.event("vehicle", mode="AUTO", armed=True, system=1)
    assert operator.event("parameter")["name"] == "AT_W_GRASS"
    assert air.heard_ground.wait(DEADLINE_S)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--connect", "carrier-pigeon:9"], "udpin:0.0.0.0:14550"),
        (["--connect", "udpin:127.0.0.1:99999"], "is not a link"),
        (["--connect", "udpin:127.0.0.1:0", "--script", "/nowhere.json"], "cannot read the script"),
        (["--connect", "udpin:127.0.0.1:0", "--log", "/nowhere/it.jsonl"], "cannot write the log"),
    ],
)
def test_what_cannot_start_says_why_on_one_line(
    start: Callable[..., Operator], arguments: list[str], said: str
) -> None:
    operator = start(*arguments)
    assert operator.end() == 2
    assert operator.process.stderr is not None
    error = operator.process.stderr.read()
    assert said in error
    assert error.count("\n") == 1
