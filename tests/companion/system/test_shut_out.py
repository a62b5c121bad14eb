"""A process that was broken into reaches neither memory nor descriptors of the one that started it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[3]
ATTACK = """
import ctypes, os, sys

from companion.system.child_process import shut_out

libc = ctypes.CDLL(None, use_errno=True)
secret = ctypes.create_string_buffer(b"the signing key")


class Vector(ctypes.Structure):
    _fields_ = [("base", ctypes.c_void_p), ("length", ctypes.c_size_t)]


def reached(pid):
    found = []
    try:
        with open(f"/proc/{pid}/mem", "rb") as memory:
            memory.seek(ctypes.addressof(secret))
            found += ["mem"] * (memory.read(15) == b"the signing key")
    except OSError:
        pass
    taken = ctypes.create_string_buffer(15)
    near, far = Vector(ctypes.addressof(taken), 15), Vector(ctypes.addressof(secret), 15)
    for name in ("process_vm_readv", "process_vm_writev"):
        if getattr(libc, name)(pid, ctypes.byref(near), 1, ctypes.byref(far), 1, 0) == 15:
            found.append(name)
    try:
        target = os.pidfd_open(pid)
        found += ["pidfd_getfd"] * (libc.syscall(438, target, 0, 0) >= 0)
    except OSError:
        pass
    try:
        found += ["fd"] * bool(os.listdir(f"/proc/{pid}/fd"))
    except OSError:
        pass
    return found


def attacked():
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        libc.prctl(4, 1)
        os.write(write, " ".join(reached(os.getppid())).encode() or b"nothing")
        os._exit(0)
    os.waitpid(child, 0)
    return os.read(read, 1000).decode()


if os.geteuid() == 0:  # root may do it all
    os.setgroups([])
    os.setgid(65534)
    os.setuid(65534)
libc.prctl(4, 1)
print(attacked())
shut_out()
print(attacked())
"""


def test_no_process_of_the_same_user_reaches_memory_or_descriptors_of_the_supervisor() -> None:
    ran = subprocess.run(
        [sys.executable, "-c", ATTACK], cwd=ROOT, check=True, capture_output=True, text=True, timeout=60
    )
    open_before, shut = ran.stdout.splitlines()
    assert "fd" in open_before.split(), "the rest depends on kernel.yama.ptrace_scope"
    assert shut == "nothing"
