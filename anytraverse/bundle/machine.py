"""Identifies this machine by what determines the speed and the exactness of its int8 arithmetic."""

from __future__ import annotations

import hashlib
import os
import platform
import re
from dataclasses import dataclass
from pathlib import Path

from anytraverse.errors import PerceiverError
from anytraverse.perception.runtime import load_onnxruntime

X86_FLAGS = (
    "avx2",
    "avx512f",
    "avx_vnni",
    "avx_vnni_int8",
    "avx512_vnni",
    "avx512_bf16",
    "amx_int8",
    "amx_bf16",
)
ARM_FLAGS = ("asimd", "asimdhp", "asimddp", "i8mm", "bf16", "sve", "sve2", "svei8mm")
ARM_CORES = {
    0xD03: "Cortex-A53",
    0xD05: "Cortex-A55",
    0xD07: "Cortex-A57",
    0xD08: "Cortex-A72",
    0xD09: "Cortex-A73",
    0xD0A: "Cortex-A75",
    0xD0B: "Cortex-A76",
    0xD0C: "Neoverse-N1",
    0xD0D: "Cortex-A77",
    0xD40: "Neoverse-V1",
    0xD41: "Cortex-A78",
    0xD42: "Cortex-A78AE",
    0xD44: "Cortex-X1",
    0xD46: "Cortex-A510",
    0xD49: "Neoverse-N2",
    0xD4B: "Cortex-A78C",
    0xD4F: "Neoverse-V2",
}
"""Arm's own cores by their part number (implementer 0x41); other cores are named by their numbers."""


@dataclass(frozen=True)
class Machine:
    """Describes a machine.

    cpu: its name. architecture: as of `uname -m`. flags: instruction sets that matter to int8, sorted.
    cores: all of the machine, also those this process may not use. onnxruntime: its version, or "none".
    """

    cpu: str
    architecture: str
    flags: tuple[str, ...]
    cores: int
    onnxruntime: str

    @property
    def id(self) -> str:
        """A short id for file names, of all but the version of ONNX Runtime."""
        slug = re.sub(r"[^a-z0-9]+", "-", self.cpu.lower()).strip("-")[:40].strip("-") or "cpu"
        parts = (self.cpu, self.architecture, *self.flags, str(self.cores))
        return f"{slug}-{hashlib.sha256(' '.join(parts).encode()).hexdigest()[:6]}"


def this_machine() -> Machine:
    """Describe the machine that this runs on."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        text = ""
    cpu, flags = read_cpuinfo(text)
    return Machine(
        cpu=cpu or platform.processor() or "unknown CPU",
        architecture=platform.machine(),
        flags=flags,
        cores=os.cpu_count() or 1,
        onnxruntime=_onnxruntime_version(),
    )


def read_cpuinfo(text: str) -> tuple[str, tuple[str, ...]]:
    """Read name and flags from the text of /proc/cpuinfo, of x86 or Arm; "" where it gives no name.

    Where cores differ, only the flags of all cores count, since a thread may run on any core.
    """
    processors, general = _sections(text)
    words = [set((core.get("flags") or core.get("Features") or "").split()) for core in processors]
    shared = set.intersection(*words) if words else set()
    flags = tuple(sorted(shared.intersection((*X86_FLAGS, *ARM_FLAGS))))
    if any("CPU part" in core for core in processors):
        kinds = sorted({_arm_core(core) for core in processors if "CPU part" in core})
        board = general.get("Model") or general.get("Hardware") or ""
        return " ".join(filter(None, (board, "+".join(kinds)))), flags
    names = sorted({" ".join(core["model name"].split()) for core in processors if core.get("model name")})
    return "+".join(names), flags


def _sections(text: str) -> tuple[list[dict[str, str]], dict[str, str]]:
    """Return the fields of each processor's section, and those of all other sections."""
    processors, general = [], {}
    for section in re.split(r"\n\s*\n", text):
        pairs = (line.partition(":") for line in section.splitlines())
        fields = {name.strip(): value.strip() for name, colon, value in pairs if colon}
        if "processor" in fields:
            processors.append(fields)
        else:
            general.update(fields)
    return processors, general


def _arm_core(core: dict[str, str]) -> str:
    implementer, part = core.get("CPU implementer", ""), core["CPU part"]
    try:
        if int(implementer, 16) == 0x41:
            return ARM_CORES[int(part, 16)]
    except (ValueError, KeyError):
        pass
    return f"Arm {implementer} {part}".replace("  ", " ")


def _onnxruntime_version() -> str:
    try:
        return str(load_onnxruntime().__version__)
    except PerceiverError:
        return "none"
