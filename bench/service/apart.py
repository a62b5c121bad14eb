"""Proves of the processes beside the supervisor: one that hangs is killed, and none reaches another."""

from __future__ import annotations

import json
import re
import shutil
import time
from functools import partial
from pathlib import Path
from typing import Any

from bench.service.container import ContainerError
from bench.service.service import CONFIG, Figures, Service

VISION_BACK_WITHIN = 8.0
_UNITS = ("companion-vision@", "companion-network-vision@")
_STAND_IN = """[Service]
ExecStart=
ExecStart=/usr/bin/python3 -I /opt/stand_in.py
"""
_KEY = "install -m 600 -o anytraverse -g anytraverse /dev/stdin /etc/anytraverse/signing.key"
_OPEN_CONFIG = f"chgrp anytraverse /{CONFIG}; chmod 640 /{CONFIG}"
_NETWORK = "send to another computer"
"""Counts with a camera of this computer alone: systemd limits addresses where cgroups are unified, and the
container has this machine's. `vm.devices` tries it."""


def vision(service: Service) -> Figures:
    """SIGSTOP, some times: the vision process, another user's, is killed and judges again."""
    times = []
    for _ in range(3):
        service.until("it judges", service.judges, 20.0)
        service.sh("sleep 3")
        before = service.status()["vision"]["restarts"]
        begun = time.monotonic()
        service.freeze_vision()
        service.until("vision is back", partial(_judges_again, service, before), 20.0)
        times.append(round(time.monotonic() - begun, 2))
        service.restart()  # so that the next restart does not wait longer
    if max(times) > VISION_BACK_WITHIN:
        raise ContainerError(f"vision came back after {times} s")
    return {"back_s": times, "limit_s": VISION_BACK_WITHIN}


def _judges_again(service: Service, before: int) -> bool:
    said: dict[str, Any] = service.status().get("vision", {})
    return said.get("restarts", 0) > before and not said.get("trouble") and service.judges()


def stand_in(service: Service) -> Figures:
    """Somebody has broken into vision: it reaches no secret and no other process, and is killed for good."""
    shutil.copy(Path(__file__).with_name("stand_in.py"), service.container.root / "opt/stand_in.py")
    service.sh(f"openssl rand -hex 32 2>/dev/null | {_KEY} || head -c 32 /dev/urandom | {_KEY}")
    found = {}
    for unit in _UNITS:
        folder = f"/run/systemd/system/{unit}.service.d"
        service.sh(
            f"mkdir -p {folder} && cat > {folder}/stand-in.conf <<'X'\n{_STAND_IN}X\nsystemctl daemon-reload"
        )
        service.configure()
        killed = _killed(service)
        if unit == _UNITS[0]:
            path = service.container.root / CONFIG
            path.write_text(re.sub(r"(?m)^source = .*$", 'source = "folder:/var/lib"', path.read_text()))
        service.sh(f"{_OPEN_CONFIG}; systemctl restart --no-block companion")
        service.until("the stand-in speaks", partial(_said, service, unit), 30.0)
        first = service.sh("pgrep -f '[s]tand_in.py'", check=False).split()
        service.until("it is killed", partial(_is_killed, service, killed), 10.0)
        service.until("the first one is gone", partial(_is_gone, service, first), 10.0)
        found[unit.strip("@")] = _reached(_said(service, unit), unit)
        service.sh("systemctl stop companion")
        left = service.sh("pgrep -f '[s]tand_in.py'", check=False).split()
        if left:
            raise ContainerError(f"it outlives the companion: {left}")
        service.sh(f"rm -r {folder} && systemctl daemon-reload")
    service.sh("rm /etc/anytraverse/signing.key /opt/stand_in.py")
    service.configure()
    service.sh(f"chmod 644 /{CONFIG}; systemctl start companion")
    service.until("it judges again", service.judges, 20.0)
    return {"tried": len(found[_UNITS[0].strip("@")]), "reached": 0, "refused_by": found}


def _is_gone(service: Service, pids: list[str]) -> bool:
    return bool(pids) and not {*pids} & {*service.sh("pgrep -f '[s]tand_in.py'", check=False).split()}


def _is_killed(service: Service, before: int) -> bool:
    return _killed(service) > before


def _killed(service: Service) -> int:
    return service.sh("journalctl -u companion --no-pager").count("sent nonsense")


def _said(service: Service, unit: str) -> dict[str, str]:
    log = service.sh(f"journalctl -u '{unit}*' --no-pager -o cat", check=False)
    lines = [line for line in log.splitlines() if line.startswith('{"stand_in"')]
    return dict(json.loads(lines[-1])["stand_in"]) if lines else {}


def _reached(said: dict[str, str], unit: str) -> dict[str, str]:
    allowed = _NETWORK if unit == _UNITS[1] else ""
    reached = [what for what, came in said.items() if came == "reached" and what != allowed]
    if reached or len(said) < 20:
        raise ContainerError(f"{unit}: the stand-in reached {reached}; {said}")
    return said
