"""Tells which computer this is, and how it does: now, and over the recorded drives. Changes nothing."""

from __future__ import annotations

import os
import platform
from pathlib import Path

from anytraverse.bundle.machine import this_machine
from companion.desk.evidence.parts import Basis, EvidencePart, NotKnown, figures
from companion.desk.evidence.sources import Sources
from companion.system.computer import Computer

_BOARD = Path("/sys/firmware/devicetree/base/model")
"""What a board with Arm calls itself; a PC tells it in `_PC`."""
_PC = Path("/sys/class/dmi/id/product_name")
_LONGEST = 100


def computer_part(sources: Sources) -> EvidencePart:
    """Describe this computer. Takes milliseconds."""
    machine, now = this_machine(), Computer(sources.folder).measure()
    fixed = (
        ("board", _board(), ""),
        ("CPU", machine.cpu, ""),
        ("architecture", machine.architecture, ""),
        ("cores", machine.cores, ""),
        ("cores that this process may use", len(os.sched_getaffinity(0)), ""),
        ("instruction sets for networks", ", ".join(machine.flags) or "none known", ""),
        ("memory", now["memory"], "MiB"),
        ("operating system", _system(), ""),
        ("kernel", platform.release(), ""),
        ("Python", platform.python_version(), ""),
    )
    states = (
        ("disk", now["disk"], "MiB"),
        ("disk free", now["disk_free"], "MiB"),
        ("memory free", now["memory_free"], "MiB"),
        ("temperature", now["temperature"], "°C"),
        ("CPU slowed down", now["throttled"], ""),
        ("supply's voltage too low", now["under_voltage"], ""),
    )
    basis = Basis("this computer", None, sources.now, sources.now)
    found = figures(basis, (*fixed, *states))
    driven = sources.driven
    if heat := driven.temperatures:
        over = Basis("recordings", len(heat), driven.begin, driven.end)
        found += figures(over, [("temperature while it was recorded, highest", max(heat), "°C")])
    if limited := driven.throttled:
        over = Basis("recordings", len(limited), driven.begin, driven.end)
        found += figures(over, [("CPU slowed down while it was recorded", _percent(limited), "%")])
    lacking = ", ".join(name for name, value, _ in (*fixed, *states) if value is None)
    told = NotKnown(lacking, "this computer does not tell it in /sys", "the board maker's own tool")
    return EvidencePart("computer", "Computer", found, (), (told,) if lacking else ())


def _percent(states: list[bool]) -> float:
    return 100.0 * sum(states) / len(states)


def _board() -> str | None:
    for path in (_BOARD, _PC):
        try:
            told = path.read_bytes()[:_LONGEST].decode("ascii", "replace")
        except OSError:
            continue
        if name := "".join(one for one in told if one.isprintable()).strip():
            return name
    return None


def _system() -> str:
    try:
        return platform.freedesktop_os_release().get("PRETTY_NAME", platform.system())
    except OSError:
        return platform.system()
