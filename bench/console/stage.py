"""Starts what the console is tried with: simulated rovers with their daemons, and the console itself."""

from __future__ import annotations

import json
import re
import time
from pathlib import Path
from typing import Any

from companion.config.link_settings import ConnectionSettings
from companion.desk.check.here import read_status
from companion.sim.demo.child import LoggedProcess
from companion.sim.demo.config import write_config
from companion.sim.demo.director import STANDS
from companion.sim.demo.rehearsal import free_port
from companion.sim.field.control import FieldControl

CHROMIUM = "/usr/bin/chromium"
_SPEED = 1.5
_NEAR = 9.0
"""Metres ahead within which the operator sees a thing."""
_TOKEN = "0123456789abcdef"
_PAGE = f'[web]\nlisten = "127.0.0.1:0"\ntoken = "{_TOKEN}"\n'


class Rover:
    """A simulated rover with its daemon.

    link: what a ground station connects to. second_link: what another one does, past the autopilot.
    """

    def __init__(self, folder: Path, seed: int, *, network: bool = True, baud: int | None = None) -> None:
        """network: the link carries more than a radio. baud: of a radio, whose default budgets it has."""
        folder.mkdir(parents=True)
        self.folder = folder
        self._field = LoggedProcess(
            "field",
            ["companion.sim.field", "--seed", str(seed), "--speed", str(_SPEED)],
            folder / "field.log",
        )
        ports = json.loads(self._field.first_line(30.0))
        self.link = str(ports["gcs"])
        host, _, port = ports["control"].rpartition(":")
        self._control = FieldControl(host, int(port))
        config = write_config(
            folder,
            camera=f"field:{ports['frames']}",
            link=ports["companion"],
            policy="hold",
            speed=_SPEED,
            network=network,
        )
        if baud is not None:
            _set_budgets(config, baud)
        config.write_text(
            re.sub(r'\[web\]\nlisten = ".*"\n', _PAGE, config.read_text(encoding="utf-8")), encoding="utf-8"
        )
        config.chmod(0o600)  # it holds a token
        port = str(free_port())
        self.second_link = f"udpout:127.0.0.1:{port}"
        with config.open("a", encoding="utf-8") as more:
            more.write(f'\n[link.more.second]\nurl = "udpin:127.0.0.1:{port}"\nbudget = 0.0\n')
        self.daemon = LoggedProcess("daemon", ["companion", "run", str(config)], folder / "daemon.log")
        self._blocked_since: float | None = None
        self._held_by_script = False
        self.script_holds = 0
        """How often the script on the autopilot held, since the companion was silent."""

    def drive(self, within: float = 40.0) -> None:
        """Let it drive once its daemon says ok."""
        deadline = time.monotonic() + within
        while self.status().get("state") != "ok":
            if time.monotonic() > deadline:
                raise self.daemon.error("saw nothing that it knows")
            time.sleep(0.2)
        self._control.start()

    def status(self) -> dict[str, Any]:
        """Read the daemon's status file; empty while there is none."""
        return read_status(self.folder / "state")[1]

    def page(self, within: float = 40.0) -> str:
        """Return the address of its own page, with the token, once it is up."""
        deadline = time.monotonic() + within
        while not (url := self.status().get("web", {}).get("url")):
            if time.monotonic() > deadline:
                raise self.daemon.error("showed no page")
            time.sleep(0.2)
        return f"{url}?token={_TOKEN}"

    def zone(self) -> str:
        """Say where it is: "meadow", "forest" or "gravel"."""
        return str(self._control.status()["zone"])

    def thing_ahead(self) -> str | None:
        """Name the nearest thing on the trail ahead."""
        thing = self._nearest()
        return None if thing is None else str(thing["kind"])

    def tidy(self) -> None:
        """Take a thing away that was named, and has kept the rover standing for two seconds.

        Also drive on after the script on the autopilot held, as it does when this computer was too busy.
        """
        held = str(self.status().get("held_by")).startswith("script")
        if held and not self._held_by_script:
            self.script_holds += 1
            self._control.mode("AUTO")
        self._held_by_script = held
        thing = self._nearest()
        standing = self._control.status()["speed"] < STANDS
        if not (standing and thing is not None and self.status().get("state") == "blocked"):
            self._blocked_since = None
        elif self._blocked_since is None:
            self._blocked_since = time.monotonic()
        elif time.monotonic() - self._blocked_since > 2.0:
            self._control.remove(thing["id"])
            self._blocked_since = None

    def close(self) -> None:
        """End its processes."""
        self.daemon.stop()
        self._control.close()
        self._field.stop()

    def _nearest(self) -> dict[str, Any] | None:
        things: list[dict[str, Any]] = self._control.status()["things_ahead"]
        ahead = [thing for thing in things if thing["surprise"] and thing["distance"] < _NEAR]
        return min(ahead, key=lambda thing: float(thing["distance"]), default=None)


def _set_budgets(config: Path, baud: int) -> None:
    """Write the default budgets, or those that the companion advises for so slow a line."""
    room = ConnectionSettings(f"serial:/dev/ttyAMA0:{baud}", asked_budget=50.0, budget=50.0).room
    default = ConnectionSettings("udpin:127.0.0.1:0")
    own = min(default.budget, room // 2)
    text = config.read_text(encoding="utf-8")
    budgets = f"budget = {own:g}\nasked_budget = {min(default.asked_budget, room - own):g}\n"
    config.write_text(text.replace("\n[journal]", f"{budgets}\n[journal]", 1), encoding="utf-8")


def start_console(links: list[str], out: Path, *more: str) -> tuple[LoggedProcess, str]:
    """Start a console on these links. Returns it, and the address of its page."""
    connect = [part for link in links for part in ("--connect", link)]
    console = LoggedProcess(
        "console", ["gcs_plugin.console", "--no-browser", *connect, *more], out / "console.log"
    )
    return console, console.first_line(30.0).split()[-1]
