"""Runs the image by podman as docs/install.md says, and does to it what `Service` does to the service."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from bench.service.container import ContainerError, only_child, run, run_inside
from bench.service.rover import FieldProcess
from bench.service.service import CONFIG, STATE, Figures, Service
from companion.desk.check.running import started_at

HARDENED = ("--network=host", "--read-only", "--cap-drop=all", "--security-opt=no-new-privileges")
"""As docs/install.md has it."""
_LOGGED = 5000
_HANG = """
import ctypes, os, sys
_ATTACH, _WALL = 16, 0x40000000
if ctypes.CDLL(None).ptrace(_ATTACH, int(sys.argv[1]), 0, 0):
    sys.exit("it cannot be stopped")
for _ in range(2):  # until it stands; until it is gone
    os.waitpid(int(sys.argv[1]), _WALL)
"""
"""Stops the main thread alone, as a call of the kernel that never returns does; the others go on."""


def podman(*arguments: str) -> str:
    """Run podman and return what it wrote. Raises ContainerError."""
    return run(["podman", *arguments], f"podman {arguments[0]}").strip()


def require() -> None:
    """Check for root and podman. Raises ContainerError that says what to type."""
    if os.geteuid() != 0:
        raise ContainerError("this needs root: type: sudo make image-check")
    if shutil.which("podman") is None:
        raise ContainerError("type: sudo apt install --no-install-recommends podman crun")


def _of_this_machine() -> tuple[str, ...]:
    """Without systemd nobody asks for its health. What else a machine needs: $CONTAINERS_CONF."""
    return () if Path("/run/systemd/system").is_dir() else ("--health-interval=disable",)


class PodmanContainer:
    """A container of an image, with a folder of this machine for its settings, and a volume for its data.

    root: where both are, as in a container's root. more: further options of `podman run` from the next boot
    on. volume: how the volume is handed in.
    """

    def __init__(self, image: str) -> None:
        self.name = f"anytraverse-check-{os.getpid()}"
        self.folder = Path(tempfile.mkdtemp(prefix="anytraverse-image-"))
        self.folder.chmod(0o755)
        self.root, self._image = self.folder, image
        self.more: Sequence[str] = ()
        self.volume = ""
        (self.root / CONFIG).parent.mkdir(parents=True)
        podman("volume", "create", self.name)
        (self.root / STATE).parent.mkdir(parents=True)
        (self.root / STATE).symlink_to(podman("volume", "inspect", "--format={{.Mountpoint}}", self.name))

    def __enter__(self) -> PodmanContainer:
        return self

    def __exit__(self, *_: object) -> None:
        self.remove()
        podman("volume", "rm", "--force", self.name)
        shutil.rmtree(self.folder, ignore_errors=True)

    def boot(self) -> float:
        """Make a new container of the image and start it. Return the seconds that podman takes."""
        self.remove()
        begun = time.monotonic()
        asked = ["run", "--detach", f"--name={self.name}", "--restart=always", *HARDENED, *_of_this_machine()]
        asked += [f"--volume={(self.root / CONFIG).parent}:/etc/anytraverse:ro"]
        asked += [f"--volume={self.name}:/{STATE}{self.volume}", "--health-cmd=companion status"]
        podman(*asked, *self.more, self._image)
        return time.monotonic() - begun

    def run(self, command: str, *, timeout: float = 60.0, check: bool = True) -> str:
        """Run a shell command in the container, as its user, and return what it wrote."""
        return run_inside(["podman", "exec", self.name], command, timeout=timeout, check=check)

    def power_off(self) -> None:
        """Stop the container in order."""
        podman("stop", self.name)

    def remove(self) -> None:
        """Stop and remove the container; settings and volume stay."""
        podman("rm", "--force", "--ignore", "--time=10", self.name)


class ContainedService(Service):
    """The companion in a container of podman's."""

    watchdog_says = "Timeout (0:00:05)!"
    container: PodmanContainer

    def __init__(self, container: PodmanContainer, field: FieldProcess) -> None:
        super().__init__(container, field)
        self._hanging: subprocess.Popen[bytes] | None = None

    def show(self, name: str) -> str:
        """Return what a property of a unit is for a container."""
        said = podman(
            "inspect",
            "--type=container",
            "--format={{.State.Pid}} {{.State.Running}} {{.State.ExitCode}} {{.RestartCount}}",
            self.container.name,
        )
        pid, running, code, restarts = said.split()
        return {
            "MainPID": only_child(int(pid)) or "0" if pid != "0" else "0",
            "ActiveState": "active" if running == "true" else "inactive",
            "Result": "success" if code == "0" else f"exit code {code}",
            "NRestarts": restarts,
        }[name]

    def log(self, lines: int) -> str:
        """Return the newest lines of the log."""
        done = subprocess.run(
            ["podman", "logs", f"--tail={min(lines, _LOGGED)}", self.container.name],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=60.0,
            check=False,
        )
        return done.stdout

    def start(self) -> None:
        """Start it."""
        podman("start", self.container.name)

    def stop(self) -> None:
        """Stop it in order."""
        podman("stop", self.container.name)

    def restart(self) -> None:
        """Stop and start it."""
        podman("restart", self.container.name)

    def kill(self) -> None:
        """Kill the supervisor."""
        os.kill(self.pid, signal.SIGKILL)

    def freeze(self) -> None:
        """Have the supervisor's main thread hang."""
        self._hanging = subprocess.Popen([sys.executable, "-c", _HANG, str(self.pid)])

    def freeze_vision(self) -> None:
        """Have the vision process hang."""
        for pid in self.visions():
            os.kill(pid, signal.SIGSTOP)

    def visions(self) -> list[int]:
        """Return the vision process, as numbered on this machine, or none."""
        return [pid for pid, _ in self.children(self.pid) if b"companion.vision" in _command(pid)]

    def children(self, parent: int) -> list[tuple[int, str]]:
        """Return the processes that `parent` has started or inherited, and their states, "Z" for a zombie."""
        found = []
        for stat in Path("/proc").glob("[0-9]*/stat"):
            with contextlib.suppress(OSError):
                state, ppid, *_ = stat.read_text().rpartition(")")[2].split()
                if int(ppid) == parent:
                    found.append((int(stat.parent.name), state))
        return found

    def status(self) -> Figures:
        """Return the status file, with the process's number on this machine; {}: an earlier one's."""
        said, pid = super().status(), self.pid
        began = started_at(pid)
        with contextlib.suppress(OSError):
            written = (self.container.root / STATE / "status.json").stat().st_mtime
            if said and began is not None and written > began and said.get("pid") == _number_inside(pid):
                return {**said, "pid": pid}
        return {}

    def is_healthy(self) -> bool:
        """Whether podman's check of its health passes."""
        asked = ["podman", "healthcheck", "run", self.container.name]
        return subprocess.run(asked, capture_output=True, timeout=60.0, check=False).returncode == 0

    @contextlib.contextmanager
    def configured(self, pattern: str, line: str) -> Iterator[None]:
        """Run a new container with another line in companion.toml, then one with the old line again."""
        path = self.container.root / CONFIG
        good = path.read_text()
        changed = re.sub(f"(?m)^{pattern}.*$", lambda _: line, good, count=1)
        if changed == good:
            raise ContainerError(f"companion.toml has no {pattern}")
        path.write_text(changed)
        try:
            self.container.boot()
            yield
        finally:
            path.write_text(good)
            self.container.more, self.container.volume = (), ""
        self.container.boot()
        self.until("it judges again", self.judges, 20.0)


def _command(pid: int) -> bytes:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


def _number_inside(pid: int) -> int:
    said = re.search(r"(?m)^NSpid:.*\t(\d+)$", Path(f"/proc/{pid}/status").read_text())
    return int(said[1]) if said else 0
