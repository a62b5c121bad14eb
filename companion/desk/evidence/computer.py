"""Tells which computer this is, and how it does: now, and over the recorded drives. Changes nothing."""

from __future__ import annotations

import platform

from anytraverse.bundle.machine import this_machine
from companion.desk.evidence.parts import Basis, EvidencePart
from companion.desk.evidence.sources import Sources
from companion.system.computer import Computer


def computer_part(sources: Sources) -> EvidencePart:
    """Describe this computer. Takes milliseconds."""
    part, machine, now = EvidencePart("Computer"), this_machine(), Computer(sources.folder).measure()
    told = (
        ("CPU", machine.cpu, ""),
        ("architecture", machine.architecture, ""),
        ("instruction sets for networks", ", ".join(machine.flags) or "none known", ""),
        ("memory", now["memory"], "MiB"),
        ("disk", now["disk"], "MiB"),
        ("kernel", platform.release(), ""),
        ("Python", platform.python_version(), ""),
        ("temperature", now["temperature"], "°C"),
        ("CPU slowed down", now["throttled"], ""),
        ("supply's voltage too low", now["under_voltage"], ""),
    )
    part.tell(Basis("this computer", None, sources.now, sources.now), *told)
    driven = sources.driven
    if heat := driven.temperatures:
        part.tell(driven.basis(len(heat)), ("temperature while it was recorded, highest", max(heat), "°C"))
    if limited := driven.throttled:
        slowed = 100.0 * sum(limited) / len(limited)
        part.tell(driven.basis(len(limited)), ("CPU slowed down while it was recorded", slowed, "%"))
    if lacking := ", ".join(name for name, value, _ in told if value is None):
        part.lack(lacking, "this computer does not tell it in /sys", "the board maker's own tool")
    return part
