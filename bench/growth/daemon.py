"""Runs a whole daemon in real time, and measures whether the memory of its main process rises.

`python -m companion run` with the standing rover of `bench.faults.standing`, its page open in a browser, and
a recording. A thing comes into the way every 20 s: the rover is held, and drives on once the call is
answered, by turns with a word. A parameter is set every ten seconds, and the autopilot says nothing in the
last six of every five minutes. So few scenes are stored that they do not count for the slope.
"""

from __future__ import annotations

import http.client
import re
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path

from pymavlink.dialects.v20 import development as mavlink

from anytraverse.operations import SetWord
from bench.faults.standing import NotSeen, Standing
from bench.faults.standing_calls import drive_on, held_call
from bench.series import PlottedSeries
from companion.sim.demo.rehearsal import free_port
from companion.wire.ids import COMPONENT_ID, Motion
from companion.wire.parameters import SUMMARY_RATE

MINUTES, QUICK = 60.0, 0.2
SCENES = 16
_SAMPLES = 150
_CALL_EVERY, _SET_EVERY, _SILENT_EVERY, _SILENT_FOR = 20.0, 10.0, 300.0, 6.0
_WORDS = "gravel", "dirt path", "dry grass"


def measure(*, quick: bool, minutes: float | None) -> list[PlottedSeries]:
    """Measures so many minutes; by default `MINUTES`, quick: `QUICK`."""
    with tempfile.TemporaryDirectory(prefix="growth-") as folder:
        return drive(60.0 * (minutes or (QUICK if quick else MINUTES)), Path(folder))


def drive(seconds: float, folder: Path) -> list[PlottedSeries]:
    """Lets a daemon run for so long, and returns the memory of its main process, its threads and open files.

    Its own memory is without the files of libraries. PSS counts them in shares, and rises when another
    program that uses them ends.
    """
    memory = PlottedSeries("Memory of a whole daemon's main process", "hours", "MB")
    held = PlottedSeries("Threads and open files of a whole daemon's main process", "hours", "")
    port, over = free_port(), threading.Event()
    with Standing(folder, policy="hold", recorded=50, web=f'listen = "127.0.0.1:{port}"') as rover:
        text = rover.config.read_text(encoding="utf-8")
        rover.config.write_text(text.replace("[journal]", f"[journal]\nscenes = {SCENES}"), encoding="utf-8")
        rover.start()
        threading.Thread(target=_browse, args=(port, over), daemon=True).start()
        assert rover.daemon is not None
        process = Path(f"/proc/{rover.daemon.process.pid}")
        begun = now = measured_at = time.monotonic()
        called_at = set_at = float("-inf")
        calls = answered = 0
        while now < begun + seconds:
            rover.wire.reboots = (now - begun) % _SILENT_EVERY >= _SILENT_EVERY - _SILENT_FOR
            if now - called_at >= _CALL_EVERY and not rover.wire.reboots:
                called_at, calls = now, calls + 1
                answered += _answers(rover, calls)
            if now - set_at >= _SET_EVERY:
                set_at = now
                _set_parameter(rover, calls)
            rover.run(0.05)
            now = time.monotonic()
            if now - measured_at >= seconds / _SAMPLES:
                measured_at, hours = now, round((now - begun) / 3600, 5)
                own, pss = _memory(process)
                memory.add("main process, own memory", hours, [own])
                memory.add("main process, PSS", hours, [pss])
                held.add("threads", hours, [len(list((process / "task").iterdir()))])
                held.add("open files", hours, [len(list((process / "fd").iterdir()))])
        over.set()
        print(f"{rover.judged()} frames, {calls} calls, {answered} answered", flush=True)
    return [memory, held]


def _answers(rover: Standing, number: int) -> bool:
    """Lets a thing come into the way, and answers the call. False where something was late."""
    try:
        call = held_call(rover)
        if number % 2:
            rover.answer(call, Motion.NONE, [SetWord(_WORDS[number % 3], 1.0 - number % 5 / 10)])
        drive_on(rover, call, [])
    except NotSeen:  # other programs use this computer, too
        rover.thing = False
        return False
    return True


def _set_parameter(rover: Standing, number: int) -> None:
    """Sets how often summaries come."""
    values = 1, COMPONENT_ID, SUMMARY_RATE.encode(), 1.0 + number % 4 / 4, 9
    message = mavlink.MAVLink_param_set_message(*values)
    rover.wire.write(bytes(message.pack(mavlink.MAVLink(None, 255, 190))))


def _memory(process: Path) -> tuple[float, float]:
    """Returns the MB of its own, and its PSS."""
    text = (process / "smaps_rollup").read_text()
    kb = {name: int(value) for name, value in re.findall(r"^(\w+): +(\d+) kB$", text, re.M)}
    return kb["Anonymous"] / 1024, kb["Pss"] / 1024


def _browse(port: int, over: threading.Event) -> None:
    """Has the page's stream open, and fetches each picture that it tells of, as the page does."""
    while not over.wait(1.0):
        with suppress(OSError, http.client.HTTPException):
            stream = http.client.HTTPConnection("127.0.0.1", port, timeout=10.0)
            stream.request("GET", "/events")
            for line in stream.getresponse():
                if line.startswith(b"event: picture"):
                    picture = http.client.HTTPConnection("127.0.0.1", port, timeout=10.0)
                    picture.request("GET", "/live.jpg")
                    picture.getresponse().read()
                    picture.close()
