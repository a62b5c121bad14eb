"""What somebody types into the settings of the page stays theirs: it is neither lost nor turned round."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from companion.config.request import LEAVE
from tests.companion.observers.page import played
from tests.companion.observers.page.browser import needs_browser, opened_tab
from tests.companion.observers.page.played_settings import FILE, SettingsStage

pytestmark = [pytest.mark.slow, needs_browser]
WORDS = FILE + '[words]\ngrass = 0.5\n"dry grass" = 0.3\n'


class Typing:
    """The settings of a page."""

    def __init__(self, stage: SettingsStage, tab: Any) -> None:
        self.stage, self.tab = stage, tab
        stage.until(tab.locator("#settings").is_visible)
        tab.get_by_role("button", name="Show settings").click()
        stage.until(lambda: tab.locator("#settings .setting").count() > 50)

    def fill(self, field: str, text: str) -> None:
        self.tab.locator(f"#f-{field}").fill(text)
        self.tab.locator(f"#f-{field}").press("Tab")

    def value(self, field: str) -> str:
        return str(self.tab.locator(f"#f-{field}").input_value())

    def review(self) -> str:
        return str(self.tab.locator("#settings .review").inner_text())

    def look(self) -> str:
        """Have it shown what would change."""
        self.tab.get_by_role("button", name="Show what would").click()
        self.stage.until(lambda: "This would change" in self.review() or "Nothing was" in self.review())
        return self.review()

    def lose(self) -> None:
        """Have the page's process end, and come back."""
        process, told = self.stage.pid(), self.tab.locator("body")
        os.kill(process, signal.SIGKILL)

        def lost() -> bool:
            return "no connection to the rover" in told.inner_text()

        self.stage.until(lambda: lost() or self.stage.pid() not in (process, 0))
        self.stage.until(lambda: self.stage.up() and not lost())


@contextmanager
def typing(folder: Path, text: str = WORDS) -> Iterator[Typing]:
    stage = SettingsStage(folder, token=played.TOKEN, text=text)
    try:
        stage.until(stage.up)
        with opened_tab(f"{stage.page.url}?token={played.TOKEN}") as tab:
            yield Typing(stage, tab)
    finally:
        stage.close()


def test_words_that_are_emptied_are_no_words_also_where_the_vehicle_s_file_has_some(tmp_path: Path) -> None:
    (tmp_path / "vehicle.toml").write_text("[words]\nmud = -1.0\ngrass = 1.0\n")
    with typing(tmp_path, FILE.replace('file = ""', 'file = "vehicle.toml"')) as at:
        at.fill("words", "")
        assert "+words = {}" in at.look()


def test_lines_of_which_one_is_wrong_stay_while_others_are_changed(tmp_path: Path) -> None:
    typed = "grass: 0.5\nmud: -1\nsand 0.3"
    with typing(tmp_path) as at:
        at.fill("words", typed)
        at.fill("call-votes", "3")
        assert at.value("words") == typed
        assert "NAME: VALUE" in at.tab.locator("#f-words-problem").inner_text()
        at.tab.get_by_role("button", name="Take all back").click()
        assert at.value("words") == "grass: 0.5\ndry grass: 0.3"
        assert at.tab.locator("#f-words-problem").inner_text() == ""


def test_words_are_not_written_over_newer_ones_in_the_file(tmp_path: Path) -> None:
    with typing(tmp_path) as at:
        at.stage.file.write_text(WORDS.replace("[words]\n", "[words]\nmud = -1.0\n"))
        at.fill("words", "grass: 0.4\ndry grass: 0.3")
        assert "words: changed in the file since the companion was started" in at.look()


def test_words_made_of_older_ones_do_not_wait_any_more_once_there_are_newer(tmp_path: Path) -> None:
    with typing(tmp_path) as at:
        at.fill("words", "grass: 0.4\ndry grass: 0.3")
        at.stage.file.write_text(WORDS.replace("[words]\n", "[words]\nmud = -1.0\n"))
        at.stage.start_again()
        at.lose()
        at.stage.until(lambda: "words was changed meanwhile: change it again." in at.review())
        assert "mud: -1" in at.value("words")


def test_that_it_was_started_again_is_said_once_it_was(tmp_path: Path) -> None:
    with typing(tmp_path) as at:
        at.fill("call-votes", "3")
        at.look()
        at.tab.get_by_role("button", name="Write and restart").click()
        at.stage.until(lambda: "It is written" in at.review())
        at.stage.armed = True
        at.stage.until(lambda: not (at.stage.run / LEAVE).exists())
        at.lose()
        at.stage.until(lambda: "was not started again yet" in at.review())
        at.stage.start_again()
        at.lose()
        at.stage.until(lambda: "the companion was started again." in at.review())
        assert at.value("call-votes") == "3"


def test_what_is_being_typed_stays_when_the_page_comes_back(tmp_path: Path) -> None:
    with typing(tmp_path) as at:
        at.tab.locator("#f-words").focus()
        at.tab.keyboard.type("mud: -1\n")
        typed = at.value("words")
        at.lose()
        for _ in range(100):
            at.stage.turn()
        assert at.value("words") == typed
