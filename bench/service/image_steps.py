"""What is proven of the image alone, one function a step. Each returns its figures, or raises."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import signal
import sqlite3
import tempfile
import threading
import time
import tty
from collections.abc import Iterator
from pathlib import Path
from socket import AF_INET, SOCK_DGRAM, socket

from pymavlink import mavutil
from pymavlink.dialects.v20.common import MAVLink

from bench.cameras.servers import serving
from bench.service.container import ROOT, ContainerError
from bench.service.podman import ContainedService, podman
from bench.service.rover import answer
from bench.service.service import CONFIG, STATE, Figures

_ONBOARD_COMPUTER = 191
_STARTS_WITHIN = 30.0
_TTY = "/dev/ttyACM0"
_DIALOUT = 20
"""The group of serial ports in Debian."""
_WRITER = "/opt/anytraverse/bin/python -m bench.cameras.raw_writer 640 480 10"
_WAITS = re.compile(r"failed (\d+) times in a row: starts in (\d+) s")


def start(service: ContainedService) -> Figures:
    """Start it from nothing: the ground hears it, its page is well, and it may write to its volume alone."""
    service.configure()
    begun = time.monotonic()
    took = service.container.boot()
    heartbeat = _heartbeat(service.field.ground) - begun
    service.until("it judges", service.judges, 20.0)
    judging = time.monotonic() - begun
    service.until("its page says that all is well", service.page_is_well, 20.0)
    told = answer(service.field.ground, "go", 30.0)  # once it has heard a summary
    status = service.sh("companion status 2>/dev/null").splitlines()[0]
    service.until("it is healthy", service.is_healthy, 20.0)
    writable = service.sh(_WRITABLE).split()
    if writable != [f"/{STATE}"]:
        raise ContainerError(f"it may write to {writable}")
    return {
        "run_s": round(took, 2),
        "first_heartbeat_s": round(heartbeat, 2),
        "judging_s": round(judging, 2),
        "user": service.sh("id -nG").split(),
        "status": status,
        "answer": told,
    }


_WRITABLE = f"for one in / /etc/anytraverse /opt /usr /{STATE}; do test -w $one && echo $one; done"


def _heartbeat(ground: str) -> float:
    """Return when the ground hears the companion's first heartbeat, in s of time.monotonic()."""
    connection = mavutil.mavlink_connection(ground, source_system=255, source_component=190)
    try:
        until = time.monotonic() + _STARTS_WITHIN
        while time.monotonic() < until:
            connection.mav.heartbeat_send(6, 8, 0, 0, 0)  # the field sends to who was heard
            heard = connection.recv_match(type="HEARTBEAT", blocking=True, timeout=0.05)
            if heard is not None and heard.get_srcComponent() == _ONBOARD_COMPUTER:
                return time.monotonic()
    finally:
        connection.close()
    raise ContainerError(f"no heartbeat of the companion came within {_STARTS_WITHIN:.0f} s")


def crash_loop(service: ContainedService) -> Figures:
    """A configuration that cannot be read: it is started again and again, waits longer, and says why."""
    path = service.container.root / CONFIG
    good = path.read_text()
    path.write_text("this is no TOML")
    try:
        service.restart()
        service.until("it waits longer", lambda: len(_waits(service)) >= 3, 60.0)
        log = service.log(100)
    finally:
        path.write_text(good)
    service.restart()
    mended = service.until("it judges again", service.judges, 20.0)
    if "companion.toml" not in log or "Traceback" in log:
        raise ContainerError(f"it does not say what is wrong: {log}")
    return {"waits_s": _waits(service)[:3], "mended_back_s": mended}


def _waits(service: ContainedService) -> list[int]:
    return [int(seconds) for _, seconds in _WAITS.findall(service.log(1000))]


def serial(service: ContainedService) -> Figures:
    """A terminal in the place of a serial port carries the link."""
    with _terminal(service.field.link) as name:
        service.container.more = [f"--volume={name}:{_TTY}"]
        with service.configured("url = ", f'url = "serial:{_TTY}:115200"'):
            judging = service.until("it judges", service.judges, 20.0)
            heard = service.status()["link"]["autopilot"]
            told = answer(service.field.ground, "word gravel 1", 30.0)
    if told.startswith("the companion"):  # any other is an acknowledgement
        raise ContainerError(f"an answer over the serial port: {told}")
    return {"judging_s": judging, "autopilot": heard, "answer": told}


@contextlib.contextmanager
def _terminal(url: str) -> Iterator[str]:
    """Make a terminal with the rights of a serial port, whose other end is the link at udpout:HOST:PORT."""
    host, port = url.split(":")[1:]
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    name = os.ttyname(theirs)
    os.chown(name, 0, _DIALOUT)
    os.chmod(name, 0o660)
    with socket(AF_INET, SOCK_DGRAM) as field:
        field.settimeout(0.2)
        field.connect((host, int(port)))
        companion = MAVLink(None, srcSystem=1, srcComponent=_ONBOARD_COMPUTER)
        heartbeat = companion.heartbeat_encode(18, 8, 0, 0, 0).pack(companion)
        over = threading.Event()

        def to_field() -> None:
            frames = MAVLink(None)  # the field takes whole ones
            frames.robust_parsing = True
            with contextlib.suppress(OSError):  # closed below
                while not over.is_set():
                    for frame in frames.parse_buffer(os.read(ours, 1024)) or ():
                        field.send(frame.get_msgbuf())

        def to_companion() -> None:
            with contextlib.suppress(OSError):
                while not over.is_set():
                    os.write(ours, _received(field, heartbeat))

        for one in (to_field, to_companion):
            threading.Thread(target=one, daemon=True).start()
        try:
            yield name
        finally:
            over.set()
            os.write(theirs, b"\n")  # so that `to_field` ends
            os.close(theirs)


def _received(field: socket, heartbeat: bytes) -> bytes:
    """Hear the field, which sends to who was heard; the companion sends to an autopilot that was."""
    try:
        return field.recv(2048)
    except TimeoutError:
        field.send(heartbeat)
        return b""


def camera(service: ContainedService) -> Figures:
    """A camera of the network, and one that a program of the image reads; no zombie is left of it."""
    read = {}
    with serving("mjpeg_server") as server:
        source = f'source = "http://127.0.0.1:{server.port}/trail"'
        with service.configured("source = ", source):
            read["http"] = service.until("it reads", lambda: _reads(service), 20.0)
    service.container.more = [f"--volume={ROOT}/bench:/srv/bench:ro"]
    lines = ["width = 640", "height = 480", 'pixel_format = "gray"']
    source = "\n".join([f'source = "pipe:env PYTHONPATH=/srv {_WRITER}"', *lines])
    with service.configured("source = ", source):
        read["pipe"] = service.until("it reads", lambda: _reads(service), 20.0)
        for _ in range(3):
            killed = service.visions()[0]
            os.kill(killed, signal.SIGKILL)
            service.until("vision is back", lambda: {*service.visions()} - {killed}, 20.0)  # noqa: B023
        read["pipe, vision killed"] = service.until("it reads again", lambda: _reads(service), 20.0)
        pid = int(podman("inspect", "--format={{.State.Pid}}", service.container.name))
        zombies = [one for one in service.children(pid) if one[1] == "Z"]
    if zombies:
        raise ContainerError(f"zombies are left: {zombies}")
    return {"read_s": read, "zombies": 0}


def _reads(service: ContainedService) -> bool:
    said = service.status()
    trouble = said.get("vision", {}).get("trouble", "starting")
    return not trouble and said.get("camera", {}).get("read", 0) > 20 and said.get("frames", 0) > 0


def kept(service: ContainedService) -> Figures:
    """What it was told is there in a new container, and the journal is whole."""
    told = answer(service.field.ground, "word gravel 1", 30.0)
    service.until("the word counts", lambda: "gravel" in service.status().get("words", ""), 20.0)
    before = service.status()["words"]
    service.kill()
    service.container.remove()
    with tempfile.TemporaryDirectory() as folder:
        for file in (service.container.root / STATE).glob("journal.db*"):
            shutil.copy(file, folder)
        with contextlib.closing(sqlite3.connect(Path(folder, "journal.db"))) as journal:
            (whole,) = journal.execute("PRAGMA integrity_check").fetchone()
    service.container.boot()
    service.until("it judges", service.judges, 20.0)
    after = service.status()["words"]
    if whole != "ok" or after != before:
        raise ContainerError(f"the journal is {whole}; words were {before}, and are {after}")
    return {"answer": told, "words": after, "integrity_check": whole}


def unwritable(service: ContainedService) -> Figures:
    """A volume that it may not write: it says which folder, and what to do, without a traceback."""
    service.container.volume = ":ro"
    service.container.boot()
    service.until("it is started again", lambda: int(service.show("NRestarts")) > 1, 30.0)
    lines = [line for line in service.log(200).splitlines() if STATE in line]
    trouble = "Traceback" in service.log(200)
    service.container.volume = ""
    service.container.boot()
    service.until("it judges again", service.judges, 20.0)
    if not lines or trouble:
        raise ContainerError(f"it does not say which folder: {lines}")
    return {"says": lines[-1]}
