"""What an operator types."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.operations import ForgetCall, ForgetWord, NewEpisode, Operation, OtherPlace, SetWord, Tap
from companion.wire.answers import Answer, CancelIncident, PackIncident
from companion.wire.ids import Motion, Policy
from companion.wire.typed_answers import NO_BOX, NO_FRAME, CommandError
from companion.wire.words_text import operation_text
from gcs_plugin.terminal.commands import Command, Select, SetPolicy, Show, parse

BOX = (0.4, 0.55, 0.6, 0.8)


@pytest.mark.parametrize(
    ("line", "command"),
    [
        ("go", (None, Answer(0, Motion.GO))),
        ("  OK ", (None, Answer(0, Motion.GO))),
        ("stay", (None, Answer(0, Motion.STAY))),
        ("look", (None, Answer(0, Motion.LOOK_AGAIN))),
        ("look  again", (None, Answer(0, Motion.LOOK_AGAIN))),
        ("bush: -1", (None, Answer(0, Motion.NONE, (SetWord("bush", -1.0),)))),
        ("Dry  Grass: .5;", (None, Answer(0, Motion.NONE, (SetWord("dry grass", 0.5),)))),
        (
            "bush: -1; grass: 1",
            (None, Answer(0, Motion.NONE, (SetWord("bush", -1.0), SetWord("grass", 1.0)))),
        ),
        ("bush: -1, go", (None, Answer(0, Motion.GO, (SetWord("bush", -1.0),)))),
        ("bush: -1 go", (None, Answer(0, Motion.GO, (SetWord("bush", -1.0),)))),
        ("bush:-1; go", (None, Answer(0, Motion.GO, (SetWord("bush", -1.0),)))),
        ("grass: 1 look again", (None, Answer(0, Motion.LOOK_AGAIN, (SetWord("grass", 1.0),)))),
        ("tap drum -1", (None, Answer(0, Motion.NONE, (Tap(NO_FRAME, NO_BOX, "drum", -1.0),)))),
        ("tap drum -1 go", (None, Answer(0, Motion.GO, (Tap(NO_FRAME, NO_BOX, "drum", -1.0),)))),
        ("tap drum -1, stay", (None, Answer(0, Motion.STAY, (Tap(NO_FRAME, NO_BOX, "drum", -1.0),)))),
        (
            "tap oil drum -1 0.40 0.55 0.60 0.80",
            (None, Answer(0, Motion.NONE, (Tap(NO_FRAME, BOX, "oil drum", -1.0),))),
        ),
        ("tap area 51: -1", (None, Answer(0, Motion.NONE, (Tap(NO_FRAME, NO_BOX, "area 51", -1.0),)))),
        (
            "tap drum -1; bush: -1 go",
            (None, Answer(0, Motion.GO, (Tap(NO_FRAME, NO_BOX, "drum", -1.0), SetWord("bush", -1.0)))),
        ),
        ("forget bush", (None, Answer(0, Motion.NONE, (ForgetWord("bush"),)))),
        ("forget bush go", (None, Answer(0, Motion.GO, (ForgetWord("bush"),)))),
        ("forget call 7", (None, Answer(0, Motion.NONE, (ForgetCall(7),)))),
        ("new episode", (None, Answer(0, Motion.NONE, (NewEpisode(),)))),
        ("7 go", (None, Answer(7, Motion.GO))),
        ("C7 go", (None, Answer(7, Motion.GO))),
        ("h9: stay", (None, Answer(9, Motion.STAY))),
        ("7: bush: -1 go", (None, Answer(7, Motion.GO, (SetWord("bush", -1.0),)))),
        ("rover 2 go", (2, Answer(0, Motion.GO))),
        ("rover 2: C7 tap drum -1", (2, Answer(7, Motion.NONE, (Tap(NO_FRAME, NO_BOX, "drum", -1.0),)))),
        ("rover 2", (2, Select())),
        ("rover 2 status", (2, Show("status"))),
        ("policy hold", (None, SetPolicy(Policy.HOLD))),
        ("policy guide", (None, SetPolicy(Policy.GUIDE))),
        ("rover 2 Policy  OFF", (2, SetPolicy(Policy.OFF))),
        ("policy: -1", (None, Answer(0, Motion.NONE, (SetWord("policy", -1.0),)))),
        ("calls", (None, Show("calls"))),
        ("Quit", (None, Show("quit"))),
    ],
)
def test_a_line_means_what_it_says(line: str, command: object) -> None:
    assert parse(line) == command


@pytest.mark.parametrize("line", ["", "   ", "# a comment"])
def test_an_empty_line_means_nothing(line: str) -> None:
    assert parse(line) is None


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("bush", "`bush: -1`"),
        ("bush -1", "`bush: -1`"),
        ("bush: 2", "-1 (never drive) to 1 (drive)"),
        ("bush: nan", "not a weight"),
        ("bush: 0,5", "not a weight"),
        ("bush:", "not a weight"),
        (": 1", "empty"),
        ("bush: 1; bush: -1", "stands twice"),
        ("bush: 1;; grass: 1", "nothing between"),
        ("tap", "no command"),
        ("tap drum", "`tap drum -1`"),
        ("tap drum -1 0.4 0.5", "left top right bottom"),
        ("tap drum -1 0.6 0.5 0.4 0.8", "left top right bottom"),
        ("tap drum -1 0.4 0.5 0.6 1.8", "fractions"),
        ("forget", "no command"),
        ("go forth", "no command"),
        ("go bush: -1", "`bush: -1, go`"),
        ("7 STAY bush: -1; grass: 1", '"STAY" does not begin a word'),
        ("forget bush: -1", "`forget bush`"),
        ("set bush: -1", "`bush: -1`"),
        ("policy hold: 1", '"policy" does not begin a word'),
        ("7", "`7 go`"),
        ("0 go", "call 0 cannot be"),
        ("70000 go", "call 70000 cannot be"),
        ("rover 300 go", "rover 300 cannot be"),
        ("go" * 600, "1000 at most"),
        ("b\x07ush: 1", "cannot be printed"),
        ("tap area 51 -1", "left top right bottom"),
    ],
)
def test_a_wrong_line_is_refused_with_an_example_on_one_line(line: str, said: str) -> None:
    with pytest.raises(CommandError) as caught:
        parse(line)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("line", ["gold: 1", "setting sun: 1", "go: 1", "forgetmenot: -1"])
def test_a_word_may_begin_like_an_order(line: str) -> None:
    word, _, weight = line.partition(": ")
    assert parse(line) == (None, Answer(0, Motion.NONE, (SetWord(word, float(weight)),)))


_FIRST = st.from_regex(r"[abefijkmnpquvwxyzäöü][a-zäöü]{2,9}", fullmatch=True)
_NEXT = st.from_regex(r"[a-z0-9äöü]{1,8}", fullmatch=True)
_WORDS = st.builds(
    lambda first, others: " ".join([first, *others]), _FIRST, st.lists(_NEXT, max_size=3)
).filter(lambda word: word.split()[-1] not in ("go", "ok", "stay", "look", "again"))
_WEIGHTS = st.integers(-100, 100).map(lambda n: n / 100)
_SIDES = st.lists(st.integers(0, 100), min_size=4, max_size=4, unique=True).map(
    lambda n: (min(n[:2]) / 100, min(n[2:]) / 100, max(n[:2]) / 100, max(n[2:]) / 100)
)
_CHANGES = st.lists(
    st.one_of(
        st.builds(SetWord, _WORDS, _WEIGHTS),
        st.builds(Tap, st.just(NO_FRAME), st.just(NO_BOX) | _SIDES, _WORDS, _WEIGHTS),
        st.builds(ForgetWord, _WORDS.filter(lambda word: not word.startswith("call "))),
        st.builds(ForgetCall, st.integers(1, 0xFFFF)),
        st.just(NewEpisode()),
        st.builds(OtherPlace, st.integers(0, 0xFFFF)),
    ),
    min_size=1,
    max_size=5,
    unique_by=lambda change: getattr(change, "word", repr(change)),
)


def written(change: Operation) -> str:
    match change:
        case SetWord(word, weight):
            return f"{word}: {weight}"
        case Tap(_, box, word, weight):
            return f"tap {word}: {weight} " + " ".join(map(str, () if box == NO_BOX else box))
        case ForgetWord(word):
            return f"forget {word}"
        case ForgetCall(call_id):
            return f"forget call {call_id}"
        case NewEpisode():
            return "new episode"
        case OtherPlace(call_id):
            return f"other place {call_id}" if call_id else "other place"


@pytest.mark.slow
@settings(max_examples=100, deadline=None)
@given(
    _CHANGES,
    st.sampled_from(["", ", go", " go", " stay", ", look again"]),
    st.none() | st.integers(1, 0xFFFF),
    st.none() | st.integers(1, 255),
)
def test_what_is_written_out_is_read_back(
    changes: list[Operation], motion: str, call_id: int | None, rover: int | None
) -> None:
    line = "; ".join(map(written, changes)).strip() + motion
    line = line if call_id is None else f"{call_id}: {line}"
    line = line if rover is None else f"rover {rover} {line}"
    motions = {"go": Motion.GO, "stay": Motion.STAY, "look again": Motion.LOOK_AGAIN}
    expected = motions.get(motion.lstrip(", "), Motion.NONE)
    assert parse(line) == (rover, Answer(call_id or 0, expected, tuple(changes)))


@settings(max_examples=200, deadline=None)
@given(st.text(max_size=80) | st.text("go stay lok tap 7c:;,.-1 rover\t", max_size=60))
def test_rubbish_is_a_command_or_a_clear_refusal(line: str) -> None:
    refusal = ""
    try:
        parse(line)
    except CommandError as error:
        refusal = str(error)
    assert "\n" not in refusal


def test_what_a_call_s_file_says_of_an_answer_can_be_typed_again() -> None:
    operations = (
        SetWord("old wall", -0.25),
        Tap(7, (0.1, 0.25, 0.5, 0.75), "area 51", 0.3),
        ForgetWord("bush"),
        ForgetCall(7),
        NewEpisode(),
        OtherPlace(),
        OtherPlace(7),
    )
    typed = [parse(operation_text(operation)) for operation in operations]
    assert typed == [
        (None, Answer(0, Motion.NONE, (change,)))
        for change in (
            SetWord("old wall", -0.25),
            Tap(NO_FRAME, (0.1, 0.25, 0.5, 0.75), "area 51", 0.3),
            ForgetWord("bush"),
            ForgetCall(7),
            NewEpisode(),
            OtherPlace(),
            OtherPlace(7),
        )
    ]


@pytest.mark.parametrize(
    ("line", "reply"),
    [
        ("not the same place", (None, Answer(0, Motion.NONE, (OtherPlace(),)))),
        ("Not that place C12", (None, Answer(0, Motion.NONE, (OtherPlace(12),)))),
        ("other place; gravel: 1, go", (None, Answer(0, Motion.GO, (OtherPlace(), SetWord("gravel", 1.0))))),
        ("rover 2 other place 12", (2, Answer(0, Motion.NONE, (OtherPlace(12),)))),
        ("other place: -1", (None, Answer(0, Motion.NONE, (SetWord("other place", -1.0),)))),
    ],
)
def test_a_match_is_refused_by_one_line(line: str, reply: tuple[int | None, Command]) -> None:
    assert parse(line) == reply


@pytest.mark.parametrize(
    ("line", "command"),
    [
        ("incident", (None, Answer(0, Motion.NONE, (PackIncident(0),)))),
        ("Incident C7", (None, Answer(0, Motion.NONE, (PackIncident(7),)))),
        ("cancel incident", (None, Answer(0, Motion.NONE, (CancelIncident(0),)))),
        ("rover 2 cancel incident 7", (2, Answer(0, Motion.NONE, (CancelIncident(7),)))),
        ("incident: -1", (None, Answer(0, Motion.NONE, (SetWord("incident", -1.0),)))),
    ],
)
def test_an_incident_file_is_asked_for_and_cancelled(line: str, command: tuple[int | None, Command]) -> None:
    assert parse(line) == command


def test_no_call_has_the_number_70000() -> None:
    with pytest.raises(CommandError, match="call 70000 cannot be"):
        parse("other place 70000")


@pytest.mark.parametrize(
    "line",
    ["tap THING -1 go", "THING: -1, go", "7 GROUND: 1, go", "thing: -1", "7 bush: -1; Tap Thing -1 go"],
)
def test_a_name_that_was_left_open_is_not_taken_for_a_word(line: str) -> None:
    with pytest.raises(CommandError, match="stands for its name: write what it is"):
        parse(line)


def test_a_word_that_is_spelled_like_it_in_small_letters_is_one() -> None:
    assert parse("ground: 1") is not None
    assert parse("moving thing: -1; tap thing of wood -1 go") is not None
