"""The console, a rover that calls, and pages in a browser."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from companion.wire.call_report import CallReport
from tests.gcs_plugin.console.browser import CHROMIUM
from tests.gcs_plugin.console.served import Served


@pytest.fixture
def served() -> Iterator[Served]:
    made = Served()
    yield made
    made.close()


@pytest.fixture
def open_page(served: Served) -> Iterator[Callable[..., Any]]:
    """Opens the page: open_page(width). before: a script that runs first. Its errors fail the test."""
    errors: list[str] = []
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as browsers:
        browser = browsers.chromium.launch(executable_path=str(CHROMIUM), args=["--no-sandbox"])

        def opened(width: int = 1280, scheme: str = "light", height: int = 900, before: str = "") -> Any:
            tab = browser.new_page(viewport={"width": width, "height": height}, color_scheme=scheme)
            if before:
                tab.add_init_script(before)
            tab.on("pageerror", lambda error: errors.append(str(error)))
            tab.goto(served.url)
            return tab

        yield opened
        browser.close()
    assert errors == []


@pytest.fixture
def rover(served: Served, tiny_rover: Callable[..., Any], thing_call: CallReport) -> Any:
    made = tiny_rover(1, thing_call)
    made.files = {"/state.json": b'{"state": "calling", "words": {"mud": -1}, "given": {}}'}
    served.rovers.append(made)
    return made
