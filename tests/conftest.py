"""What holds for all tests: the same examples on every machine, and no time limits on a busy one."""

from __future__ import annotations

from hypothesis import settings

settings.register_profile("companion", deadline=None, derandomize=True)
settings.load_profile("companion")
