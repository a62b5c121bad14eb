"""Boots a small Debian with systemd in a container, runs commands in it, and leaves nothing behind."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SUITE = "bookworm"
PACKAGES = ("systemd", "systemd-sysv", "dbus", "udev", "procps", "python3", "python3-venv")
TOOLS = {"debootstrap": "debootstrap", "systemd-nspawn": "systemd-container", "nsenter": "util-linux"}
_EXTRA = "oak,words"
"""What is downloaded holds all that a rover with an OAK needs, and a Debian package."""
_PLATFORMS = ("manylinux_2_17", "manylinux_2_28", "manylinux2014")
_BUILDING = 1800.0
_BOOTS_WITHIN = 60.0
_ENDS_WITHIN = 30.0


class ContainerError(Exception):
    """The container, or a command in it, failed."""


def require() -> None:
    """Check for root and the tools. Raises ContainerError that says what to type."""
    if os.geteuid() != 0:
        raise ContainerError("this boots a container and needs root: type: sudo make service")
    missing = sorted({package for tool, package in TOOLS.items() if shutil.which(tool) is None})
    if missing:
        raise ContainerError(f"type: sudo apt install {' '.join(missing)}")


def base(cache: Path) -> Path:
    """Return a bare Debian's root in `cache`, made with debootstrap the first time (some minutes, 340 MB)."""
    root = cache / SUITE
    if not root.exists():
        cache.mkdir(parents=True, exist_ok=True)
        unfinished = cache / f"{SUITE}.part"
        shutil.rmtree(unfinished, ignore_errors=True)
        asked = [
            "debootstrap",
            "--variant=minbase",
            f"--include={','.join(PACKAGES)}",
            SUITE,
            str(unfinished),
        ]
        run([*asked, *_mirror()], "debootstrap")
        unfinished.rename(root)
    return root


def wheels(cache: Path, root: Path) -> Path:
    """Return a folder with all wheels that an installation of the checkout needs in `root`."""
    folder = cache / "wheels"
    stamp, needed = folder / "pyproject.toml", (ROOT / "pyproject.toml").read_bytes() + _EXTRA.encode()
    if not stamp.exists() or stamp.read_bytes() != needed:
        folder.mkdir(parents=True, exist_ok=True)
        version = run(["chroot", str(root), "python3", "-c", _VERSION], "python3").strip()
        asked = [sys.executable, "-m", "pip", "download", "--quiet", "--dest", str(folder)]
        asked += ["--only-binary=:all:", "--python-version", version, "--implementation", "cp"]
        asked += [f"--platform={one}_{os.uname().machine}" for one in _PLATFORMS]
        with tempfile.TemporaryDirectory() as built:
            own, made = wheel(Path(built) / "own"), Path(built) / "made"
            # `pip download` builds nothing for another system.
            make = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(made)]
            run([*make, *_WITHOUT_WHEEL], "pip wheel")
            wanted = [f"{own}[{_EXTRA},pages]", "hatchling>=1.27", *map(str, made.iterdir())]
            run([*asked, *wanted], "pip download")
        for unwanted in folder.glob("anytraverse_companion-*"):
            unwanted.unlink()
        stamp.write_bytes(needed)
    return folder


_WITHOUT_WHEEL = ("argparse-manpage>=4.6",)
"""Packages that the index has as source alone. They are the same on every system."""
_VERSION = "import sys; print('%d.%d' % sys.version_info[:2])"


def wheel(folder: Path) -> Path:
    """Build the checkout's wheel in `folder` and return its path."""
    shutil.rmtree(folder, ignore_errors=True)
    asked = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    run(asked, "hatchling", cwd=ROOT)
    (built,) = folder.glob("*.whl")
    return built


class Container:
    """One Debian, thrown away at the end. It shares the network of this machine, with 127.0.0.1.

    `boot` may be called again after `power_off`: the disk is kept until `close`.
    """

    def __init__(self, base: Path, *, read_only: Sequence[tuple[Path, str]] = ()) -> None:
        """read_only: folders of this machine, and where they are in the container."""
        self.folder = Path(tempfile.mkdtemp(prefix="anytraverse-service-"))
        self.root = self.folder / "root"
        self._binds = [f"--bind-ro={here}:{there}" for here, there in read_only]
        self._process: subprocess.Popen[bytes] | None = None
        self._leader = ""
        run(["cp", "-a", "--reflink=auto", str(base), str(self.root)], "cp")

    def __enter__(self) -> Container:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def boot(self) -> float:
        """Boot, and return the seconds until systemd says `running`."""
        begun = time.monotonic()
        asked = ["systemd-nspawn", "--quiet", "--boot", f"--directory={self.root}", "--register=no"]
        asked += ["--keep-unit", f"--machine=anytraverse-{os.getpid()}", *self._binds]
        log = (self.folder / "console.log").open("ab")
        with log:
            self._process = subprocess.Popen(
                asked, stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True
            )
        said = ""
        while time.monotonic() - begun < _BOOTS_WITHIN:
            self._leader = only_child(self._process.pid)
            if self._leader:
                said = self.run("systemctl is-system-running", check=False).strip()
                if said == "running":
                    return time.monotonic() - begun
            time.sleep(0.1)
        console = (self.folder / "console.log").read_text(errors="replace")
        failed = self.run("systemctl --failed --no-legend", check=False) if self._leader else ""
        raise ContainerError(f"it did not boot: {said or 'silent'} {failed} {console[-2000:]}")

    def run(self, command: str, *, timeout: float = 60.0, check: bool = True) -> str:
        """Run a shell command as root in the container, and return what it wrote."""
        inside = [
            "nsenter",
            "--target",
            self._leader,
            "--mount",
            "--uts",
            "--ipc",
            "--pid",
            "--net",
            "--cgroup",
        ]
        path = "PATH=/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
        return run_inside([*inside, "env", "-i", path, "HOME=/root"], command, timeout=timeout, check=check)

    def power_off(self) -> None:
        """Shut down in order, or by force after 30 s."""
        if self._process is None:
            return
        if self._process.poll() is None and self._leader:
            self.run("systemctl poweroff", check=False)
        try:
            self._process.wait(_ENDS_WITHIN)
        except subprocess.TimeoutExpired:
            self._kill()
        self._process, self._leader = None, ""

    def close(self) -> None:
        """Kill what still runs, and delete the container's disk."""
        if self._process is not None:
            self._kill()
        shutil.rmtree(self.folder, ignore_errors=True)

    def _kill(self) -> None:
        assert self._process is not None
        leader = self._leader or only_child(self._process.pid)
        if leader:
            with contextlib.suppress(ProcessLookupError):
                os.kill(int(leader), signal.SIGKILL)
        self._process.kill()
        self._process.wait(_ENDS_WITHIN)


def only_child(pid: int) -> str:
    """Return the number of the process's child, "" for none."""
    try:
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    except OSError:
        return ""
    return children[0] if children else ""


def _mirror() -> list[str]:
    """The Debian mirror that apt uses here; none where apt does not say."""
    said = subprocess.run(
        ["apt-get", "indextargets", "--format", "$(REPO_URI)", "Created-By: Packages", f"Codename: {SUITE}"],
        capture_output=True,
        text=True,
        check=False,
    )
    return said.stdout.split()[:1]


def run_inside(inside: Sequence[str], command: str, *, timeout: float, check: bool) -> str:
    """Run a shell command in a container, and return what it wrote.

    inside: the program that runs others in it, with its arguments. Raises ContainerError where `check` is set
    and the command fails.
    """
    done = subprocess.run(
        [*inside, "sh", "-c", command],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=timeout,
        check=False,
    )
    if check and done.returncode != 0:
        raise ContainerError(f"{command!r} ended with {done.returncode}: {done.stdout[-3000:]}")
    return done.stdout


def run(command: Sequence[str], what: str, cwd: Path | None = None) -> str:
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=_BUILDING, check=False)
    if done.returncode != 0:
        raise ContainerError(f"{what} failed: {(done.stdout + done.stderr)[-3000:]}")
    return done.stdout
