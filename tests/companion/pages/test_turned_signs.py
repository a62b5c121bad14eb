"""A word keeps its sign on all three pages, by keys and by mouse, unless somebody agrees in red."""

from __future__ import annotations

import json
import os
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Protocol

import numpy as np
import pytest

from anytraverse.memory import Memory
from anytraverse.operations import ForgetCall, OtherPlace, SetWord, Tap
from anytraverse.preferences import Preferences
from companion.desk.drives.rehearsal import AskedCall, Rehearsal
from companion.observers.page.page import missing
from companion.wire.answers import Acknowledgement, Answer, AnyOperation
from companion.wire.ids import Motion, Reasons, Result, Stage
from companion.wire.typed_answers import placed, read_typed
from companion.wire.words_text import own_weight, turned
from tests.companion.observers.page import played
from tests.gcs_plugin.conftest import THING_CALL, TinyRover
from tests.gcs_plugin.console.served import MISSING, Served
from tests.waiting import wait_for

playwright = pytest.importorskip("playwright.sync_api")
CHROMIUM = Path("/usr/bin/chromium")
SHOTS = os.environ.get("SHOTS", "")
"""Where pictures of the red question are kept, "" for nowhere."""
pytestmark = pytest.mark.skipif(
    bool(missing() or MISSING) or find_spec("starlette") is None or not CHROMIUM.exists(),
    reason="an extra or Chromium is not installed",
)
CALL = ".call:not([data-stage=closed])"
WORDS = {"grass": 1.0, "water": -1.0, "bush": -1.0}
GIVEN = {"gravel": 1.0, "mud": -0.5}
PLACE, THING = Reasons.UNKNOWN_SCENE, Reasons.UNKNOWN_SCENE | Reasons.UNKNOWN_OBJECT
PLACE_CALL = replace(THING_CALL, reasons=PLACE, holding=True)
PATIENCE = 60.0


class PageUnderTest(Protocol):
    """A page at which a call for a new place is open."""

    url: str
    sent: list[tuple[Motion, tuple[AnyOperation, ...]]]

    def become(self, reasons: Reasons) -> None: ...
    def end_call(self) -> None: ...
    def have_words(self, words: dict[str, float]) -> None: ...
    def close(self) -> None: ...


class Turns:
    """Lets the rover speak and hear, also while the browser is slow."""

    def __init__(self, turn: Callable[[], object]) -> None:
        self._over = threading.Event()
        self._turn = turn
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._over.is_set():
            self._turn()

    def end(self) -> None:
        self._over.set()
        self._thread.join(PATIENCE)


class ConsolePage:
    def __init__(self, _folder: Path) -> None:
        self.served, self.rover = Served(), TinyRover(1, PLACE_CALL)
        self.rover.stage_after = Stage.ANSWERED
        state = {"state": "calling", "words": WORDS, "given": GIVEN, "vocabulary": []}
        self.rover.files = {"/state.json": json.dumps(state).encode()}
        self.served.rovers.append(self.rover)
        self.url = self.served.url
        self._turns = Turns(self.served.turn)

    @property
    def sent(self) -> list[tuple[Motion, tuple[AnyOperation, ...]]]:
        return [(motion, operations) for _, motion, operations in self.rover.applied]

    def become(self, reasons: Reasons) -> None:
        assert self.rover.call is not None
        self.rover.call = replace(self.rover.call, reasons=reasons)

    def end_call(self) -> None:
        assert self.rover.call is not None
        self.rover.call = replace(self.rover.call, stage=Stage.CLOSED)
        self.rover.stage_after = Stage.CLOSED  # words without a call open none

    def have_words(self, words: dict[str, float]) -> None:
        state = {"state": "ok", "words": words, "given": GIVEN, "vocabulary": []}
        self.rover.files = {"/state.json": json.dumps(state).encode()}

    def close(self) -> None:
        self._turns.end()
        self.served.close()


class RoversOwnPage:
    def __init__(self, folder: Path) -> None:
        (folder / "calls").mkdir()
        record = {"id": 7, "reasons": ["unknown_scene"], "answers": []}
        (folder / "calls" / "7.json").write_text(json.dumps(record))
        self.stage = played.Stage(folder, token=played.TOKEN)
        self.sent: list[tuple[Motion, tuple[AnyOperation, ...]]] = []
        self.stage.page.answer = self._answer
        opened: dict[str, Any] = {"id": 7, "kind": "call", "stage": "open", "frame_id": 4711, "age": 3}
        opened["worst_tile_box"] = list(THING_CALL.worst_tile_box or ())
        self.stage.news["state"] |= {"open": opened, "words": WORDS, "given": GIVEN}
        self.become(PLACE)
        self.stage.until(self.stage.up, PATIENCE)
        self.url = f"{self.stage.page.url}?token={played.TOKEN}"
        self._turns = Turns(self.stage.turn)

    def _answer(self, payload: bytes, _at: float) -> None:
        message = Answer.unpack(payload)[0]
        if (message.motion, message.operations) not in self.sent:
            self.sent.append((message.motion, message.operations))
        done = Acknowledgement.without_figures(message.transaction, message.target, Result.APPLIED, "noted")
        self.stage.page.acknowledge(done)

    def become(self, reasons: Reasons) -> None:
        names = [str(one.name).lower() for one in Reasons if one and one in reasons]
        self.stage.news["state"] |= {"reasons": names}

    def end_call(self) -> None:
        self.stage.news["state"]["open"] = None

    def have_words(self, words: dict[str, float]) -> None:
        self.stage.news["state"]["words"] = words

    def close(self) -> None:
        self._turns.end()
        self.stage.close()


class RehearsalPage:
    def __init__(self, _folder: Path) -> None:
        from companion.desk.drives.browser_desk import BrowserDesk

        memory = Memory("m", Preferences.of(WORDS), given=GIVEN)
        thresholds = SimpleNamespace(scene=0.9)
        judge = SimpleNamespace(
            engine=SimpleNamespace(memory=memory, settings=SimpleNamespace(thresholds=thresholds))
        )
        found, drive = Rehearsal(), SimpleNamespace(title="a drive", count=9)
        self.call = AskedCall(7, "7.jpg", 1.0, PLACE_CALL, np.ones(1, np.float32), b"", b"")
        found.calls.append(self.call)
        self.desk = BrowserDesk(judge, ["grass"], found, drive)  # type: ignore[arg-type]
        self.sent: list[tuple[Motion, tuple[AnyOperation, ...]]] = []
        self.desk.__enter__()
        self.url = self.desk.url
        self._thread = threading.Thread(target=self._ask, daemon=True)
        self._thread.start()

    def _ask(self) -> None:
        try:
            while line := self.desk.ask(self.call, ""):
                answer = placed(read_typed(line), self.call.data)
                self.sent.append((answer.motion, answer.operations))
        except KeyboardInterrupt:
            pass

    def become(self, reasons: Reasons) -> None:
        self.call.data = replace(self.call.data, reasons=reasons)
        self.desk._tell(1, "asking")

    def end_call(self) -> None:
        raise NotImplementedError

    def have_words(self, words: dict[str, float]) -> None:
        raise NotImplementedError

    def close(self) -> None:
        self.desk._end(b"")
        self._thread.join(PATIENCE)
        self.desk.__exit__(None, None, None)


class Person:
    """Sits at a page."""

    def __init__(self, page: PageUnderTest, tab: Any) -> None:
        self.page, self.tab = page, tab
        self.card = tab.locator(CALL).first
        self.word = self.card.get_by_label("Its name", exact=True)
        self.weight = self.card.get_by_label("Weight", exact=True)
        self.about = self.card.get_by_label("It names", exact=True)
        self.go = self.card.locator("button.go")
        self.question = self.card.locator(".turning")

    def until(self, fits: Callable[[], bool]) -> None:
        wait_for(fits, PATIENCE, self.tab.locator("body").inner_text)

    def keys(self, *names: str) -> None:
        for name in names:
            self.tab.keyboard.press(name)

    def shows(self, part: Any, text: str) -> None:
        self.until(lambda: part.inner_text() == text)

    def focus(self) -> str:
        return str(self.tab.evaluate("document.activeElement.textContent"))

    def shoot(self, name: str) -> None:
        if SHOTS:
            self.tab.screenshot(path=f"{SHOTS}/{name}.png")


@pytest.fixture(params=[ConsolePage, RoversOwnPage, RehearsalPage])
def page(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[PageUnderTest]:
    made: PageUnderTest = request.param(tmp_path)
    yield made
    made.close()


@pytest.fixture
def person(page: PageUnderTest) -> Iterator[Person]:
    errors: list[str] = []
    with playwright.sync_playwright() as browsers:
        browser = browsers.chromium.launch(executable_path=str(CHROMIUM), args=["--no-sandbox"])
        tab = browser.new_page(viewport={"width": 1280, "height": 900})
        tab.set_default_timeout(1000 * PATIENCE)
        tab.on("pageerror", lambda error: errors.append(str(error)))
        tab.goto(page.url)
        made = Person(page, tab)
        made.until(made.card.is_visible)
        made.until(lambda: made.card.get_by_role("button", name="water", exact=True).is_visible())
        yield made
        browser.close()
    assert errors == []


def test_by_keys_a_word_proposes_its_own_weight_and_turns_only_by_a_second_button(person: Person) -> None:
    for typed, shown in [
        ("Water", "Water −1, and go"),
        ("  bush ", "Bush −1, and go"),
        ("gravel", "Gravel +1, and go"),
        ("mud", "Mud −0.5, and go"),
        ("sand", "Sand +1, and go"),
    ]:
        person.word.focus()
        person.tab.keyboard.type(typed)
        person.shows(person.go, shown)
        assert person.about.input_value() == "word"
        person.keys("Escape")
        person.shows(person.go, "Go")
    person.weight.focus()
    person.keys("Home", "Escape")
    person.word.focus()
    person.tab.keyboard.type("sand")
    person.shows(person.go, "Sand +1, and go")  # the weight before Esc is gone
    person.keys("Escape")
    person.word.focus()
    person.tab.keyboard.type("water")
    person.weight.focus()
    person.keys("End")
    person.shows(person.go, "Water +1, and go")
    person.word.focus()
    person.keys("Enter")
    person.until(person.question.is_visible)
    assert "Water was −1. All that fits it becomes drivable." in person.question.inner_text()
    person.shoot(f"keys-{type(person.page).__name__}")
    assert person.focus() == "Keep water −1"
    person.keys("g", "Enter")  # who presses twice keeps it
    person.until(lambda: not person.question.is_visible())
    person.shows(person.go, "Water −1, and go")
    person.weight.focus()
    person.keys("End")
    person.go.focus()
    person.keys("s")
    person.until(person.question.is_visible)
    person.keys("Escape")
    person.until(lambda: not person.question.is_visible())
    time.sleep(0.5)
    assert person.page.sent == []
    person.word.focus()
    person.tab.keyboard.type("water")
    person.weight.focus()
    person.keys("End")
    person.word.focus()
    person.keys("Enter")
    person.until(person.question.is_visible)
    person.keys("Tab")
    assert person.focus() == "Turn water to +1, and go"
    person.keys("Enter")
    person.until(lambda: person.page.sent == [(Motion.GO, (SetWord("water", 1.0),))])


def test_by_mouse_a_call_that_gains_a_thing_sets_its_defaults_anew(person: Person) -> None:
    card, box = person.card, THING_CALL.worst_tile_box
    assert box is not None
    card.get_by_role("button", name="grass", exact=True).click()
    person.shows(person.go, "Grass +1, and go")
    person.word.fill("log")
    person.shows(person.go, "Log +1, and go")
    person.page.become(THING)
    person.shows(person.go, "Log −1, and go")
    assert person.about.input_value() == "tap"
    person.go.click()
    assert "has changed, so nothing was sent" in card.inner_text()
    time.sleep(2.1)
    person.word.fill("grass")
    person.shows(person.go, "Grass +1, and go")  # it is drivable wherever it stands
    person.weight.fill("-1")
    person.shows(person.go, "Grass −1, and go")
    person.go.dblclick()
    person.until(person.question.is_visible)
    assert "Grass was +1. All that fits it becomes not drivable." in person.question.inner_text()
    turn = person.question.locator("button.turn")
    assert turn.evaluate("shown => getComputedStyle(shown).backgroundColor") == "rgb(160, 30, 30)"
    turn.scroll_into_view_if_needed()
    person.shoot(f"mouse-{type(person.page).__name__}")
    person.question.get_by_role("button", name="Keep grass +1").click()
    person.until(lambda: not person.question.is_visible())
    time.sleep(0.5)
    assert person.page.sent == []
    person.shows(person.go, "Grass +1, and go")
    person.weight.fill("-1")
    person.go.click()
    turn.click()
    person.until(lambda: len(person.page.sent) == 1)
    ((motion, (tap,)),) = person.page.sent
    assert motion is Motion.GO
    assert isinstance(tap, Tap)
    assert (tap.word, tap.weight) == ("grass", -1.0)


def test_by_mouse_a_slider_that_turns_a_word_is_asked_about_too(person: Person) -> None:
    slider = person.tab.get_by_role("slider", name="Weight of water")
    if isinstance(person.page, RehearsalPage):  # there what is changed always goes with an answer
        slider.fill("1")
        person.shows(person.go, "Water +1, and go")
        person.go.click()
        person.until(person.question.is_visible)
        person.question.locator("button.turn").click()
        person.until(lambda: person.page.sent == [(Motion.GO, (SetWord("water", 1.0),))])
        return
    person.page.end_call()
    person.until(lambda: person.tab.locator(CALL).count() == 0)
    question = person.tab.locator(".turning:visible")
    slider.fill("1")
    person.until(question.is_visible)
    question.get_by_role("button", name="Keep water −1").click()
    person.until(lambda: slider.input_value() == "-1")
    time.sleep(0.5)
    assert person.page.sent == []
    person.tab.get_by_label("New word").focus()
    person.tab.keyboard.type("Mud")
    person.keys("Enter")  # its own weight turns nothing
    person.until(lambda: person.page.sent == [(Motion.NONE, (SetWord("mud", -0.5),))])
    slider.fill("0.5")
    person.until(question.is_visible)
    person.keys("Escape")
    person.until(lambda: slider.input_value() == "-1")
    slider.fill("0.5")
    person.until(question.is_visible)
    question.locator("button.turn").click()
    person.until(lambda: person.page.sent[1:] == [(Motion.NONE, (SetWord("water", 0.5),))])


@pytest.mark.parametrize("page", [ConsolePage, RoversOwnPage], indirect=True)
def test_undoing_an_answer_turns_a_sign_back_only_by_a_second_button(person: Person) -> None:
    person.word.fill("water")
    person.weight.fill("1")
    person.go.click()
    person.question.locator("button.turn").click()
    person.until(lambda: len(person.page.sent) == 1)
    person.page.have_words({**WORDS, "water": 1.0})
    person.page.end_call()
    card = person.tab.locator(".call").first
    undo, question = card.get_by_role("button", name="Undo"), card.locator(".turning")
    person.until(lambda: person.tab.locator(CALL).count() == 0)
    person.until(undo.is_visible)
    slider = person.tab.get_by_role("slider", name="Weight of water")
    person.until(lambda: slider.input_value() == "1")
    undo.click()
    person.until(question.is_visible)
    assert "Water was +1. All that fits it becomes not drivable." in question.inner_text()
    person.shoot(f"undo-{type(person.page).__name__}")
    assert person.focus() == "Keep water +1"
    time.sleep(1.5)
    assert question.is_visible(), "news of the rover does not take it away"
    person.keys("Escape")
    person.until(lambda: not question.is_visible())
    undo.focus()
    person.keys("Enter")
    person.until(question.is_visible)
    person.keys("Enter")
    person.until(lambda: not question.is_visible())
    time.sleep(0.5)
    assert len(person.page.sent) == 1
    undo.click()
    question.get_by_role("button", name="Turn water to −1, and undo").click()
    person.until(lambda: person.page.sent[1:] == [(Motion.NONE, (ForgetCall(7), SetWord("water", -1.0)))])
    person.until(lambda: not undo.is_visible())


@pytest.mark.parametrize("page", [RoversOwnPage], indirect=True)
def test_refusing_a_known_place_turns_a_sign_back_only_by_a_second_button(person: Person) -> None:
    assert isinstance(person.page, RoversOwnPage)
    changed = {"water": [-1, 1], "grass": [0.5, 1], "mud": [-1, None], "sand": [None, 1]}
    person.page.have_words({**WORDS, "water": 1.0, "sand": 1.0})
    person.page.stage.news["state"]["known_place"] = {"call": 5, "similarity": 0.97, "changed": changed}
    place = person.tab.locator(".place")
    other, question = place.get_by_role("button", name="It is another place"), place.locator(".turning")
    person.until(other.is_visible)
    other.click()
    person.until(question.is_visible)
    assert question.locator("p").all_inner_texts() == ["Water was +1. All that fits it becomes not drivable."]
    question.get_by_role("button", name="Keep water +1").click()
    person.until(lambda: not question.is_visible())
    time.sleep(0.5)
    assert person.page.sent == []
    other.click()
    question.locator("button.turn").click()
    person.until(lambda: person.page.sent == [(Motion.NONE, (OtherPlace(5),))])


BOTH = """async (cases) => {
  const { ownWeights, propose, turned } = await import("/weights.js");
  return cases.map(([word, typed, words, given, thing]) => {
    const used = Object.entries(words).map(([word, weight]) => ({ word, weight }));
    const own = ownWeights({ words: used, given });
    const { weight, was, turns } = propose(word, typed, own, thing);
    return [weight, was, turns, turned([{ word, weight }], own).length > 0];
  });
}"""


@pytest.mark.parametrize("page", [RehearsalPage], indirect=True)
def test_pages_and_terminals_propose_the_same_weights(person: Person) -> None:
    weights = [-1.0, -0.5, 0.0, 0.3, 1.0]
    some = [None, *weights]
    cases = [
        (
            "water",
            typed,
            {} if used is None else {"water": used},
            before,
            thing,
        )
        for typed in some
        for used in some
        for before in (None, {}, *({"water": weight} for weight in weights))
        for thing in (False, True)
    ]
    for case, told in zip(cases, person.tab.evaluate(BOTH, cases), strict=True):
        word, typed, words, given, thing = case
        own = own_weight(word, words, given or {})
        weight = next(one for one in (typed, own, -1.0 if thing else 1.0) if one is not None)
        asks = bool(turned([SetWord(word, weight)], words, given or {}, {}, read=given is not None))
        assert told == [weight, own, asks, asks], case
