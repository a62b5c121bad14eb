"""The service in a container: its state, and what is done to it."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from bench.service.container import ContainerError
from bench.service.rover import FieldProcess

CONFIG = "etc/anytraverse/companion.toml"
STATE = "var/lib/anytraverse"
_WAITS = re.compile(r"failed \d+ times in a row: waits \d+ s before it starts")
_STEP = 0.05

Figures = dict[str, Any]


class RunningContainer(Protocol):
    """What a container can do. root: its files, as far as the steps read and write them."""

    root: Path

    def run(self, command: str, *, timeout: float = 60.0, check: bool = True) -> str: ...
    def boot(self) -> float: ...
    def power_off(self) -> None: ...


class Service:
    """The service that systemd starts in the container.

    watchdog_says: what the log says of a supervisor that hung.
    """

    watchdog_says = "Watchdog timeout"

    def __init__(self, container: RunningContainer, field: FieldProcess) -> None:
        self.container, self.field = container, field

    def sh(self, command: str, *, timeout: float = 60.0, check: bool = True) -> str:
        """Run a command in the container."""
        return self.container.run(command, timeout=timeout, check=check)

    def show(self, name: str) -> str:
        """Return a property of the unit."""
        return self.sh(f"systemctl show --property={name} --value companion").strip()

    def log(self, lines: int) -> str:
        """Return the newest lines of the log."""
        return self.sh(f"journalctl -u companion --no-pager -n {lines}", check=False)

    def start(self) -> None:
        """Start it."""
        self.sh("systemctl start companion")

    def stop(self) -> None:
        """Stop it in order."""
        self.sh("systemctl stop companion")

    def restart(self) -> None:
        """Stop and start it."""
        self.sh("systemctl restart companion")

    def kill(self) -> None:
        """Kill the supervisor."""
        self.sh(f"kill -KILL {self.pid}")

    def freeze(self) -> None:
        """Have the supervisor hang."""
        self.sh(f"kill -STOP {self.pid}")

    def freeze_vision(self) -> None:
        """Have the vision process hang."""
        self.sh("pkill -STOP -f '[-]m companion.vision'")

    @property
    def pid(self) -> int:
        """The supervisor, as numbered in the container; 0 when none runs."""
        return int(self.show("MainPID"))

    def status(self) -> Figures:
        """Return the status file, {} where it is missing or older than 3 s."""
        path = self.container.root / STATE / "status.json"
        try:
            if time.time() - path.stat().st_mtime > 3.0:
                return {}
            read = json.loads(path.read_text())
        except (OSError, ValueError):
            return {}
        return read if isinstance(read, dict) else {}

    def until(self, what: str, fits: Callable[[], object], within: float) -> float:
        """Wait, and return the seconds that it took."""
        begun = time.monotonic()
        while not fits():
            if time.monotonic() - begun > within:
                raise ContainerError(f"not within {within:.0f} s: {what}\n{self.status()}\n{self.log(30)}")
            time.sleep(_STEP)
        return round(time.monotonic() - begun, 2)

    def judges(self, since: int = 0) -> bool:
        """Whether another process than `since` runs, is ready and judges frames."""
        said = self.status()
        pid = self.pid
        return (
            pid not in (0, since)
            and said.get("pid") == pid
            and said.get("frames", 0) > 0
            and said.get("state") not in ("fault", "starting", None)
            and self.show("ActiveState") == "active"
        )

    def waits(self) -> bool:
        """Whether it waits before a start. Between two starts the text is that of the one before."""
        return self.show("SubState") == "start" and bool(_WAITS.match(self.show("StatusText")))

    def page_is_well(self) -> bool:
        """Whether /healthz of the page answers with 200, as somebody on the rover's computer asks."""
        url = self.status().get("web", {}).get("url", "")
        ask = f"python3 -c 'import urllib.request as r; print(r.urlopen(\"{url}healthz\", timeout=5).status)'"
        return bool(url) and "200" in self.sh(ask, check=False)

    def configure(self) -> None:
        """Write companion.toml for the field. The owner allows holds."""
        (self.container.root / CONFIG).write_text(self.field.config("hold"))
