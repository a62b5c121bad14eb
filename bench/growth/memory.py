"""Reads this process's own memory."""

from __future__ import annotations

import re
from pathlib import Path

from anytraverse.perception.runtime import give_back_memory


def own_mb() -> float:
    """Returns the MB (10^6 bytes) of this process's own, without what the allocator keeps for later.

    Not the proportional set size: that grows when other programs that share our libraries end.
    """
    give_back_memory()
    found = re.search(r"^Anonymous: +(\d+) kB$", Path("/proc/self/smaps_rollup").read_text(), re.M)
    assert found is not None
    return int(found[1]) * 1024 / 1e6
