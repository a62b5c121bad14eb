"""A remembered scene comes back: which one, and which words, is told; and the operator may refuse it."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anytraverse.frame import Frame
from anytraverse.operations import NewEpisode, OtherPlace, SetWord
from companion.calls.decisions import CallState
from companion.storage.call_files import MAX_CALLS, CallFiles
from companion.wire import notices
from companion.wire.ids import MAX_TEXT, Motion, Result, words_hash
from tests.companion.daemon.rig import MakeRig, Rig, picture

PROTOCOL = Path(__file__).parents[3] / "docs" / "protocol.md"
AGAIN = "Known place again: words of C1"


@pytest.fixture
def back(rig: Rig) -> Rig:
    """The place at 90 degrees was answered, the rover went home and came to a place at 100 degrees."""
    rig.see(2.0, "drum", scene=90)
    rig.answer(1, Motion.GO, SetWord("drum", 0.5), SetWord("grass", 0.8))
    rig.see(3.0, scene=90)
    assert rig.acks[-1].result is Result.APPLIED
    rig.see(1.0)
    rig.answer(0, Motion.NONE, SetWord("rock", -0.5), transaction=8)
    rig.see(1.0)
    return rig


def matched(rig: Rig) -> None:
    rig.see(3.0, scene=100)
    assert any(text.startswith(AGAIN) for text in rig.texts), rig.texts


def in_force(rig: Rig) -> bool:
    return rig.engine.memory.adoption is not None


def test_it_is_told_which_place_matched_how_well_and_with_which_words(back: Rig) -> None:
    matched(back)
    assert f"{AGAIN} (0.98)" in back.texts
    assert "C1: grass 0.8 (was 1)" in back.texts
    assert back.calls.call is None


@pytest.mark.slow
def test_a_call_tells_the_answered_scene_most_like_its_frame_and_its_words(
    back: Rig,
) -> None:
    def nearest(number: int) -> dict[str, Any] | None:
        opened = back.served.tree.open(f"/calls/{number}.json")
        found: dict[str, Any] | None = json.loads(opened.read(0, opened.size))["nearest"]
        return found

    assert nearest(1) is None, "the first scene was not taught by an answer"
    back.see(2.0, scene=40)
    assert nearest(2) == {
        "call": 1,
        "similarity": pytest.approx(np.cos(np.radians(50)), abs=1e-3),
        "words": {"drum": 0.5, "grass": 0.8},
        "picture": "/calls/1.jpg",
    }
    row = re.search(r"`nearest`:((?:.|\n  )*)", PROTOCOL.read_text())
    assert row is not None
    assert set(re.findall(r"`([a-z]+)`", row[1])) == set(nearest(2) or ())
    back.answer(2, Motion.STAY, SetWord("grass", -0.5), transaction=9)
    back.see(2.0, scene=40)
    again = nearest(2)
    assert again is not None
    assert again["call"] == 1, "not the call itself"
    back.answer(2, Motion.GO, SetWord("grass", 0.7), transaction=10)
    back.see(3.0, scene=40)
    back.see(2.0, "rock", scene=150)
    then = nearest(3)
    assert then is not None
    assert (then["call"], then["words"]) == (1, {"drum": 0.5, "grass": 0.8})


def test_a_call_tells_in_text_record_and_state_which_place_it_missed_and_by_how_much(back: Rig) -> None:
    back.see(2.0, scene=40)
    missed = "new place, low sun or haze, .76, .85 needed"  # the camera films one bright colour
    assert f"C2 {missed}" in back.texts
    opened = back.served.tree.open("/calls/2.json")
    assert json.loads(opened.read(0, opened.size))["why"] == missed
    state = back.served.tree.open("/state.json")
    assert json.loads(state.read(0, state.size))["open"]["why"] == missed


@pytest.mark.slow
def test_only_words_that_the_place_changes_are_told(rig: Rig) -> None:
    rig.see(2.0, "drum", scene=90)
    rig.answer(1, Motion.GO, SetWord("drum", 0.5), SetWord("grass", 0.8))
    rig.see(3.0, scene=90)
    rig.see(1.0)
    matched(rig)
    home = rig.texts.index("There: grass 1 (was 0.8)")
    away = rig.texts.index("C1: grass 0.8 (was 1)")
    assert home < away, rig.texts
    assert "Known place again: words of that place (1.00)" in rig.texts


@pytest.mark.slow
def test_a_refused_match_gives_the_words_back_and_the_place_is_a_new_one(back: Rig) -> None:
    before = words_hash(back.vision.words)
    matched(back)
    assert words_hash(back.vision.words) != before
    texts = len(back.texts)
    back.see(2.5, scene=100)
    back.answer(0, Motion.NONE, OtherPlace(1), transaction=10)
    back.see(2.0, scene=100)
    assert back.acks[-1].result is Result.APPLIED
    assert back.acks[-1].text.startswith("not that place; in use: ")
    assert words_hash(back.vision.words) == before
    assert not any(text.startswith(AGAIN) for text in back.texts[texts:])
    assert back.state[0] == "CALLING"
    assert back.calls.call is not None


@pytest.mark.slow
def test_what_it_taught_and_that_it_was_refused_outlive_a_restart(back: Rig) -> None:
    matched(back)
    back.see(2.5, scene=100)
    back.restart()
    back.answer(0, Motion.NONE, OtherPlace(), transaction=10)
    back.see(1.0, scene=100)
    assert back.acks[-1].result is Result.APPLIED
    back.restart()
    back.see(2.0, scene=100)
    assert not any(text.startswith("Known place again") for text in back.texts)
    assert back.state[0] == "CALLING"


@pytest.mark.slow
def test_a_refusal_that_names_no_place_waits_until_the_match_can_have_been_read(back: Rig) -> None:
    while not any(text.startswith(AGAIN) for text in back.texts):
        back.see(0.1, scene=100)
    back.answer(0, Motion.NONE, OtherPlace(), transaction=10)
    back.see(0.3, scene=100)
    assert (back.acks[-1].result, back.acks[-1].text) == (
        Result.STALE,
        "it matched just now: read which, then say so again",
    )
    back.answer(0, Motion.NONE, OtherPlace(1), transaction=11)
    back.see(0.3, scene=100)
    assert back.acks[-1].result is Result.APPLIED


@pytest.mark.slow
def test_a_refusal_does_not_refuse_a_match_that_came_while_it_waited(back: Rig) -> None:
    matched(back)
    back.see(2.5, scene=100)
    back.see(0.1)
    first = back.engine.memory.adoption
    back.answer(0, Motion.NONE, OtherPlace(), transaction=10)
    back.turn()
    back.frame_id += 1
    back.child.judge(Frame(back.frame_id, back.clock.now - 0.02, picture()))
    second = back.engine.memory.adoption
    assert second is not first, "the first place has matched"
    back.see(0.3)
    assert (back.acks[-1].result, back.acks[-1].text) == (
        Result.REFUSED,
        "another place matched: read which, and say again",
    )
    assert back.engine.memory.adoption is second


@pytest.mark.slow
def test_a_parameter_editor_refuses_the_next_match_a_moment_later(back: Rig) -> None:
    matched(back)
    back.see(2.5, scene=100)
    back.set("AT_ANSWER", 4.0)
    back.see(0.2, scene=100)
    assert not in_force(back)
    back.see(2.5, scene=90)
    assert in_force(back), "the place itself has matched"
    for _ in range(2):  # it may be sent again by itself
        back.set("AT_ANSWER", 4.0)
        back.see(0.2, scene=90)
        assert back.echoes("AT_ANSWER")[-1] == 4.0
        assert not in_force(back)


@pytest.mark.slow
def test_a_parameter_editor_that_repeats_a_refusal_of_itself_does_not_refuse_an_unread_match(
    back: Rig,
) -> None:
    while not any(text.startswith(AGAIN) for text in back.texts):
        back.see(0.1, scene=100)
    for _ in range(4):
        back.set("AT_ANSWER", 4.0)
        back.see(1.0, scene=100)
        assert back.echoes("AT_ANSWER")[-1] == 0.0
    assert in_force(back)
    back.see(5.0, scene=100)
    back.set("AT_ANSWER", 4.0)
    back.see(0.2, scene=100)
    assert not in_force(back)


@pytest.mark.slow
@pytest.mark.parametrize("named", [0, 1])
def test_a_refusal_takes_nothing_back_that_was_accepted(back: Rig, named: int) -> None:
    matched(back)
    back.see(2.5, "drum", scene=100)
    back.see(2.5, "gnome", scene=100)
    call = back.calls.call
    assert call is not None
    back.answer(call.id, Motion.GO, transaction=10)
    back.see(0.3, "gnome", scene=100)
    assert back.calls.call is call
    assert call.state is CallState.ACCEPTED
    back.answer(0, Motion.NONE, OtherPlace(named), transaction=11)
    back.see(0.1, "gnome", scene=100)
    assert back.acks[-1].result is Result.APPLIED
    assert call.state is CallState.ACCEPTED


@pytest.mark.slow
@pytest.mark.parametrize(("value", "answered"), [(14.0, True), (4.0, True), (24.0, False)])
def test_a_parameter_editor_refuses_a_match(back: Rig, value: float, answered: bool) -> None:
    matched(back)
    back.see(2.5, scene=100)
    back.set("AT_ANSWER", value)
    back.see(0.5, scene=100)
    assert back.echoes("AT_ANSWER")[-1] == (value if answered else 0.0)
    assert (back.engine.memory.adoption is None) == answered


def test_without_a_match_it_is_refused_with_the_reason(rig: Rig) -> None:
    rig.see(0.5)
    rig.answer(0, Motion.NONE, OtherPlace())
    rig.see(0.3)
    assert rig.acks[-1].result is Result.REFUSED
    assert rig.acks[-1].text == "no place has matched: there is nothing to refuse"


WORDS = st.text(st.characters(codec="utf-8", exclude_categories=("C", "Z")), min_size=1, max_size=64)
WEIGHTS = st.dictionaries(WORDS, st.integers(-100, 100).map(lambda n: n / 100), max_size=16)


@given(st.integers(0, 0xFFFF), WEIGHTS, WEIGHTS)
def test_the_texts_of_a_match_are_few_fit_and_begin_with_the_place(
    call: int, before: dict[str, float], after: dict[str, float]
) -> None:
    lines = notices.matched_words(call, before, after)
    changed = {word for word, weight in after.items() if before.get(word) != weight}
    assert len(lines) <= 3
    assert bool(lines) == bool(changed)
    for line in lines:
        assert len(line.encode()) <= MAX_TEXT
        assert line.startswith(f"C{call}: " if call else "There: ")


def test_a_word_whose_sign_a_match_turns_is_told_before_others() -> None:
    after = {**{f"a word of some length {n}": 0.5 for n in range(9)}, "water": 1.0}
    assert notices.matched_words(12, {"water": -1.0}, after)[0].startswith("C12: water 1 (was -1)")


def test_words_that_do_not_fit_are_counted() -> None:
    after = {f"a word of some length {n}": 0.5 for n in range(9)}
    lines = notices.matched_words(12, {}, after)
    assert len(lines) == 3
    assert lines[0] == "C12: a word of some length 0 0.5"
    assert lines[-1].endswith(" +6")


def test_which_place_is_in_force_is_told_until_an_answer_moves_on_or_refuses_it(back: Rig) -> None:
    matched(back)
    known = back.daemon.status.state_file()["known_place"]
    assert (known["call"], known["similarity"], known["picture"]) == (1, 0.9848, "/calls/1.jpg")
    assert known["changed"] == {"grass": [1.0, 0.8]}
    assert known["needed"] == 0.85
    row = re.search(r"`known_place`:((?:.|\n  )*)", PROTOCOL.read_text())
    assert row is not None
    assert set(re.findall(r"`([a-z]+)`", row[1])) == set(known)
    back.see(2.5, scene=100)
    back.answer(0, Motion.NONE, OtherPlace(1), transaction=10)
    back.see(0.5, scene=100)
    assert back.daemon.status.state_file()["known_place"] is None
    assert back.daemon.status.figures()["known_place"] is None


def test_pictures_of_remembered_calls_stay_when_those_of_other_calls_go(tmp_path: Path) -> None:
    files, large = CallFiles(tmp_path), tmp_path / "large"
    large.write_bytes(b"large")
    for number in range(1, MAX_CALLS + 11):
        files.begin_record(number, {}, (), {3, 5})
        files.write_pictures(number, b"small", large, b"raw", {3, 5})
    left = {path.name for path in tmp_path.iterdir()} - {"large"}
    assert {name for name in left if int(name.split(".")[0].split("-")[0]) <= 10} == {
        f"{number}{size}.jpg" for number in (3, 5) for size in ("", "-large", "-raw")
    }
    files.begin_record(MAX_CALLS + 11, {}, (), {5})
    assert not (tmp_path / "3.jpg").exists()
    assert (tmp_path / "5.jpg").read_bytes() == b"small"


def test_the_first_place_has_a_picture_too_and_only_remembered_ones_keep_theirs(make_rig: MakeRig) -> None:
    rig = make_rig(pictures=9)
    (first,) = (rig.folder / "scenes").iterdir()
    forgotten = first.with_name("0123456789abcdef.jpg")
    forgotten.write_bytes(first.read_bytes())
    rig.answer(0, Motion.NONE, NewEpisode(), transaction=8)
    rig.see(1.0)
    rig.see(2.0, "drum", scene=90)
    rig.answer(1, Motion.GO, SetWord("drum", 0.5))
    rig.see(3.0, scene=90)
    rig.see(1.0)
    known = rig.daemon.status.state_file()["known_place"]
    assert (known["call"], known["picture"][:8]) == (None, "/scenes/")
    assert (rig.folder / known["picture"][1:]).read_bytes()[:2] == b"\xff\xd8"
    assert not forgotten.exists()
    served = rig.served.tree.entries("/scenes")
    assert [f"/scenes/{one.name}" for one in served] == [known["picture"]]
