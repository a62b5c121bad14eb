"""What the tests of the rover's page in a real browser need: Playwright and Debian's Chromium."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from companion.observers.page.page import missing
from tests.companion.observers.page import played
from tests.companion.observers.page.played import Stage

CHROMIUM = Path("/usr/bin/chromium")
needs_browser = pytest.mark.skipif(
    bool(missing()) or not CHROMIUM.exists() or find_spec("playwright") is None,
    reason="the extra web, Playwright or Chromium is not installed",
)
JPEG = cv2.imencode(".jpg", np.full((240, 320, 3), 120, np.uint8))[1].tobytes()
PHONE = {"width": 390, "height": 844}
KNOWN = {
    "scene": 31,
    "call": 12,
    "similarity": 0.96,
    "needed": 0.93,
    "since": 1_790_000_000.0,
    "changed": {"gravel": [None, 1]},
    "picture": "/calls/12.jpg",
}


@contextmanager
def opened_tab(url: str, before: str = "", **context: Any) -> Iterator[Any]:
    """Open a page. before: a script that runs first. context: of the browser's. Its errors fail the test."""
    from playwright.sync_api import sync_playwright

    errors = list[str]()
    with sync_playwright() as browsers:
        browser = browsers.chromium.launch(executable_path=str(CHROMIUM), args=["--no-sandbox"])
        tab = browser.new_context(**context).new_page()
        tab.on("pageerror", lambda error: errors.append(str(error)))
        if before:
            tab.add_init_script(before)
        tab.goto(url)
        yield tab
        browser.close()
    assert errors == []


@pytest.fixture
def stage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Stage]:
    monkeypatch.setattr(played, "JPEG", JPEG)
    stage = Stage(tmp_path)
    yield stage.ready()
    stage.close()


@pytest.fixture
def tab(stage: Stage) -> Iterator[Any]:
    """The open page of a stage without a token: it only shows."""
    with opened_tab(stage.page.url) as tab:
        yield tab
