"""Settings are changed in a real browser, by a second click."""

from __future__ import annotations

from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from tests.companion.observers.page import played
from tests.companion.observers.page.browser import PHONE, needs_browser, opened_tab
from tests.companion.observers.page.played_settings import FILE, SettingsStage

pytestmark = needs_browser


def listed(home: Any) -> bool:
    """Whether the section has its settings."""
    return int(home.locator(".setting").count()) > 50


def test_a_setting_is_changed_by_a_second_click_after_what_would_change_was_shown(tmp_path: Path) -> None:
    stage = SettingsStage(tmp_path, token=played.TOKEN)
    stage.until(stage.up)
    url = f"{stage.page.url}?token={played.TOKEN}"
    with closing(stage), opened_tab(url, viewport=PHONE) as tab:
        home, review = tab.locator("#settings"), tab.locator("#settings .review")
        stage.until(home.is_visible)
        tab.get_by_role("button", name="Show settings").click()
        stage.until(partial(listed, home))
        assert tab.evaluate("document.documentElement.scrollWidth") == 390
        assert not any(secret in home.inner_html() for secret in ("s3cr3tword", played.TOKEN))
        tab.get_by_label("Search").fill("web token")
        (shown,) = home.locator(".setting:visible").all_inner_texts()
        assert shown.startswith("token")
        assert "set, and not shown" in shown
        assert f"companion config set {stage.file} web.token=VALUE" in shown
        assert home.locator(".setting:visible :is(input, select)").count() == 0

        tab.get_by_label("Search").fill("bad frames")
        field, look = tab.get_by_label("votes", exact=True), tab.get_by_role("button", name="Show what would")

        def asks_for(votes: str) -> None:
            field.fill(votes)
            field.press("Tab")

        write = tab.get_by_role("button", name="Write and restart")
        assert not review.is_visible()
        asks_for("9")
        look.click()
        stage.until(lambda: "companion.toml:9: call.votes = 9" in review.inner_text())
        assert not write.is_visible()
        asks_for("3")
        look.click()
        stage.until(write.is_visible)
        assert "-votes = 2\n+votes = 3" in review.inner_text()
        assert stage.file.read_text() == FILE
        stage.armed = True
        write.click()
        stage.until(lambda: "the vehicle is armed: disarm it first" in review.inner_text())
        stage.armed = False
        look.click()
        stage.until(write.is_visible)
        asks_for("1")
        assert not write.is_visible(), "what was shown is not what would be written"
        look.click()
        stage.until(write.is_visible)
        write.click()
        stage.until(lambda: "the companion starts again" in review.inner_text())
        assert "votes = 1" in stage.file.read_text()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_settings_are_accessible_by_axe_also_where_there_is_no_helper(
    tmp_path: Path, scheme: str
) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    for helper in (True, False):
        folder = tmp_path / str(helper)
        folder.mkdir()
        stage = SettingsStage(folder, helper=helper, token=played.TOKEN)
        stage.until(stage.up)
        url = f"{stage.page.url}?token={played.TOKEN}"
        with closing(stage), opened_tab(url, bypass_csp=True, color_scheme=scheme) as tab:
            home = tab.locator("#settings")
            stage.until(home.is_visible)
            tab.get_by_role("button", name="Show settings").click()
            stage.until(partial(listed, home))
            if helper:
                tab.get_by_label("votes", exact=True).fill("3")
                tab.get_by_label("votes", exact=True).press("Tab")
                tab.get_by_role("button", name="Show what would").click()
                stage.until(tab.get_by_role("button", name="Write and restart").is_visible)
            else:
                assert "not started by its service" in home.inner_text()
                assert home.locator(".setting :is(input, select, textarea)").count() == 0
            found = axe.Axe().run(tab)
            assert found.violations_count == 0, found.generate_report()
            assert len(found.response["passes"]) > 20, "it has looked"
