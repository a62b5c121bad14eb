"""Lets root go about in somebody else's folder with their rights only: they may have put links there."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from companion.system.computer import existing


@contextmanager
def as_owner(folder: Path) -> Iterator[None]:
    """As root, take the rights of the owner of the folder, or of the nearest folder above it that exists."""
    owner, groups = existing(folder).stat(), os.getgroups()
    if os.geteuid() != 0 or owner.st_uid == 0:
        yield
        return
    os.setgroups([])
    os.setegid(owner.st_gid)
    os.seteuid(owner.st_uid)
    try:
        yield
    finally:
        os.seteuid(0)
        os.setegid(0)
        os.setgroups(groups)
