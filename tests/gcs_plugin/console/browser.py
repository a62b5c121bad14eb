"""What the tests of the console in a real browser need: Playwright and Debian's Chromium."""

from __future__ import annotations

import os
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.gcs_plugin.console.served import MISSING

CHROMIUM = Path("/usr/bin/chromium")
AXE = Path(os.environ.get("AXE", "/nowhere"))
"""axe.min.js of axe-core, if it is there."""
CALL = ".open .call:not([data-stage=closed])"
needs_browser = pytest.mark.skipif(
    bool(MISSING) or not CHROMIUM.exists() or find_spec("playwright") is None,
    reason="the extra ground, Playwright or Chromium is not installed",
)
