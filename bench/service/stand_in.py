"""Runs in the vision process's place, as if somebody had broken into it, and says what it reached.

Nothing of the checkout is imported here. It prints one JSON object, what was tried -> what came of it, leaves
a process behind that ignores what it can, and sends the supervisor nonsense.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import socket
import struct
import time
from collections.abc import Callable
from functools import partial

LIBC = ctypes.CDLL(None, use_errno=True)
SECRETS = (
    "/etc/anytraverse/companion.toml",
    "/etc/anytraverse/signing.key",
    "/var/lib/anytraverse/journal.db",
    "/var/lib/anytraverse/status.json",
    "/var/lib/anytraverse/logs/companion.log",
    "/var/lib/anytraverse/recordings/000001.mcap",
)
_CONNECTION = 3
_PIDFD_OPEN, _PIDFD_GETFD = 434, 438
_PTRACE_SEIZE = 0x4206
_NEW_USER = 0x10000000


def main() -> None:
    """Try it all."""
    with socket.socket(fileno=os.dup(_CONNECTION)) as connection:
        credentials = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i"))
        _, (channel, *_), _, _ = socket.recv_fds(connection, 8192, 8)
    supervisor = struct.unpack("3i", credentials)[0]
    tried: dict[str, Callable[[], object]] = {f"read {path}": partial(reads, path) for path in SECRETS}
    tried |= {
        "list the recordings": lambda: os.listdir("/var/lib/anytraverse/recordings"),
        "write into the state folder": lambda: writes("/var/lib/anytraverse/stand-in"),
        "have another process killed": lambda: writes("/run/anytraverse/kill-page"),
        "have another process started": lambda: connects("/run/anytraverse-sockets/page"),
        "write beside the program": lambda: writes("/opt/anytraverse/lib/stand-in"),
        "open the supervisor's memory": lambda: os.open(f"/proc/{supervisor}/mem", os.O_RDWR),
        "read the supervisor's memory": lambda: copies("process_vm_readv", supervisor),
        "write the supervisor's memory": lambda: copies("process_vm_writev", supervisor),
        "trace the supervisor": lambda: called(LIBC.ptrace(_PTRACE_SEIZE, supervisor, None, None)),
        "take the supervisor's descriptors": lambda: takes(supervisor),
        "signal the supervisor": lambda: os.kill(supervisor, 0),
        "become root": lambda: os.setuid(0),
        "make a user namespace": lambda: called(LIBC.unshare(_NEW_USER)),
        "open a serial port": lambda: os.open("/dev/ttyS0", os.O_RDWR | os.O_NONBLOCK),
        "send to another computer": lambda: sends("192.0.2.1"),
    }
    print(json.dumps({"stand_in": {what: outcome(attempt) for what, attempt in tried.items()}}), flush=True)
    if os.fork() == 0:
        os.setsid()
        for number in set(signal.Signals) - {signal.SIGKILL, signal.SIGSTOP}:
            signal.signal(number, signal.SIG_IGN)
        time.sleep(3600)
    time.sleep(2.0)  # so that it is seen running
    with socket.socket(fileno=_CONNECTION) as connection:  # as if it had ended
        connection.shutdown(socket.SHUT_RDWR)
    os.write(channel, b"\xff" * 64)
    time.sleep(3600)


def outcome(attempt: Callable[[], object]) -> str:
    """Return "reached", or why not."""
    try:
        attempt()
    except OSError as error:
        return error.strerror or str(error)
    return "reached"


def reads(path: str) -> None:
    with open(path, "rb") as file:
        file.read(1)


def writes(path: str) -> None:
    os.close(os.open(path, os.O_WRONLY | os.O_CREAT))


def connects(path: str) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as other:
        other.connect(path)


def sends(host: str) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        out.sendto(b"stand-in", (host, 9))


def called(result: int) -> None:
    """Raise OSError as the C library says."""
    if result < 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


class _Piece(ctypes.Structure):
    _fields_ = (("base", ctypes.c_void_p), ("length", ctypes.c_size_t))


def copies(name: str, pid: int) -> None:
    """Copy a byte of another process's memory; an address that it lacks is the first thing to be refused."""
    here = ctypes.create_string_buffer(1)
    ours, theirs = _Piece(ctypes.addressof(here), 1), _Piece(0x400000, 1)
    result = getattr(LIBC, name)(pid, ctypes.byref(ours), 1, ctypes.byref(theirs), 1, 0)
    if result < 0 and ctypes.get_errno() != 14:  # EFAULT: it was let in
        called(result)


def takes(pid: int) -> None:
    """Take a descriptor of another process."""
    process = LIBC.syscall(_PIDFD_OPEN, pid, 0)
    called(process)
    called(LIBC.syscall(_PIDFD_GETFD, process, 0, 0))


if __name__ == "__main__":
    main()
