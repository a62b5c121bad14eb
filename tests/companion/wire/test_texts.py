import inspect
from collections.abc import Callable
from unittest import mock

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.assessment import Reason
from anytraverse.regions import Box
from anytraverse.roi import Corridor
from companion.wire import notices, texts
from companion.wire.ids import MAX_TEXT, Kind, Outcome, Policy

FRAME = "yellow frame"
NUMBER = st.integers(0, 0xFFFF)
FIGURE = st.none() | st.floats()
FREE = {"what", "word", "reason", "mode", "parameter", "allowed", "text", "most", "why", "setting"}
ARGUMENTS: dict[str, st.SearchStrategy[object]] = {
    "connection": st.from_regex(r"[a-z][a-z0-9_-]{0,11}", fullmatch=True),
    "call": NUMBER,
    "light": st.sampled_from(["", "dark", "low sun or haze"]),
    "number": NUMBER,
    "item": NUMBER,
    "kind": st.sampled_from(Kind),
    "outcome": st.sampled_from(Outcome),
    "value": st.sampled_from(Policy),
    "by": st.sampled_from(["", "RC18", "255/191"]),
    "switch": st.sampled_from(["RC7", "RC18"]),
    "whom": st.sampled_from(["transmitter", "255/255"]),
    "off": st.booleans(),
    "view": st.booleans(),
    "hold": st.booleans(),
    "handled": st.booleans(),
    "count": NUMBER,
    "hours": st.floats(0, 1e4),
    "reasons": st.permutations([reason.value for reason in Reason]).flatmap(
        lambda names: st.integers(1, len(names)).map(lambda many: names[:many])
    ),
    "system": st.integers(0, 255),
    "component": st.integers(0, 255),
    "misfit": st.builds(
        lambda left, width, bottom: Corridor(bottom, 0.2).misfit(Box(left, 0.3, left + width, 0.99)),
        st.floats(0.0, 0.5),
        st.floats(0.01, 0.5),
        st.floats(0.1, 1.0),
    ),
    "rate": st.floats(0.1, 60.0),
    "configured": st.floats(0.5, 60.0),
    **dict.fromkeys(
        (
            *("uncertainty", "similarity", "needed", "drivable", "share", "limit", "seconds", "metres"),
            *("speed", "fits"),
        ),
        FIGURE,
    ),
    "like": st.none() | NUMBER,
    "of": st.sampled_from(["yellow frame", "region", ""]),
    **dict.fromkeys(FREE, st.text(max_size=80)),
}
FUNCTIONS: list[Callable[..., str]] = [
    function
    for module in (texts, notices)
    for name, function in inspect.getmembers(module, inspect.isfunction)
    if function.__module__ == module.__name__
    and not name.startswith("_")
    and name not in ("matched_words", "words_turned", "unremembered")  # lists, and a part of others
]


WEIGHTS = st.tuples(st.floats(-1, 1), st.floats(-1, 1))


@given(
    st.dictionaries(st.text(min_size=1, max_size=48), WEIGHTS, max_size=16),
    st.tuples(st.integers(0, 255), st.integers(0, 255)),
)
def test_turned_words_are_told_in_few_lines_that_say_who_did_it(
    turned: dict[str, tuple[float, float]], sender: tuple[int, int]
) -> None:
    told = notices.words_turned(turned, sender)
    by = f"by {sender[0]}/{sender[1]}" if any(sender) else "by page"
    assert len(told) == min(len(turned), notices.MOST_TURNED)
    for text in told:
        assert len(text.encode()) <= MAX_TEXT
        assert text.isprintable()
        assert text.endswith(by)


@pytest.mark.slow
@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda function: function.__name__)
@settings(max_examples=30)
@given(data=st.data())
def test_every_text_fits_a_statustext_on_one_line(function: Callable[..., str], data: st.DataObject) -> None:
    names = inspect.signature(function).parameters
    arguments = {name: data.draw(ARGUMENTS[name], label=name) for name in names}
    text = function(**arguments)
    assert len(text.encode()) <= MAX_TEXT
    assert text.isprintable()


@pytest.mark.slow
@pytest.mark.parametrize(
    "function",
    [function for function in FUNCTIONS if not FREE & inspect.signature(function).parameters.keys()],
    ids=lambda function: function.__name__,
)
@settings(max_examples=30)
@given(data=st.data())
def test_a_text_of_figures_alone_is_never_cut(function: Callable[..., str], data: st.DataObject) -> None:
    names = inspect.signature(function).parameters
    arguments = {name: data.draw(ARGUMENTS[name], label=name) for name in names}
    with mock.patch.object(texts, "fit", lambda text: text):
        whole = function(**arguments)
    assert len(whole.encode()) <= MAX_TEXT


def test_a_text_that_has_no_room_for_the_answers_still_tells_the_figures() -> None:
    thing, place = texts.unknown_object(7, 0.91, 0.85, FRAME), texts.unknown_scene(65535, -1.0, 1.0, 65535)
    assert thing == "C7 unknown 91% in yellow frame, over 85% calls"
    assert place == "C65535 new place, -1.00 like C65535, 1.00 needed"
    assert texts.unknown_both(65535, 1.0, 1.0) == "C65535 new place, unknown 100%, over 100% calls"


def test_where_the_figures_leave_room_the_answers_are_named() -> None:
    for text in (
        texts.unknown_object(65535, 1.0, 1.0, FRAME),
        texts.unknown_object(65535, None, None, ""),
        texts.unknown_scene(65535, None, None, None),
        texts.unknown_both(65535, None, None),
        texts.trial_call(65535),
    ):
        assert text.endswith("/word")
    assert texts.unknown_scene(812, 0.91, 0.94, 731).endswith(": go/word")


def test_texts_say_what_happened_and_what_to_do() -> None:
    assert texts.unknown_object(7, 0.914, 0.85, FRAME) == "C7 unknown 92% in yellow frame, over 85% calls"
    assert texts.unknown_object(7, 0.384, 0.3, "region") == (
        "C7 unknown 39% in region, over 30% calls: go/word"
    )
    assert texts.unknown_scene(8, 0.918, 0.94, 3) == "C8 new place, .91 like C3, .94 needed: go/word"
    assert texts.unknown_scene(8, 0.62, 0.85, 0) == "C8 new place, .62 like a known one, .85 needed"
    assert texts.unknown_scene(8, 0.62, 0.85, None) == "C8 new place, .62, .85 needed: go/stay/word"
    assert texts.unknown_both(8, 0.91, 0.85) == "C8 new place, unknown 91%, over 85% calls: go/word"
    assert texts.blocked(9, 0.12) == "H9 blocked 12% drivable: waiting"
    assert texts.clear(Kind.HOLD, 9) == "H9 clear now, go?"
    assert texts.still_unknown(7, 0.34, 0.25) == "C7 stays open: unknown 34%, over 25% calls"
    assert texts.still_new(7, 0.62, 0.85) == "C7 stays open: new place, .62, .85 needed"
    assert texts.hold_failed(Kind.HOLD, 9) == "H9 HOLD FAILED: STOP BY HAND"
    assert texts.closed(Kind.CALL, 7, Outcome.ACCEPTED) == "C7 closed: accepted this once"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("H9 blocked 12% drivable: waiting", "H9 no room, blocked 12% drivable: waiting"),
        ("C7 unknown thing ahead: go/stay/word", "C7 no room, unknown thing ahead: go/stay/word"),
        ("C7 unknown 39% in it, over 30% calls: go/word", "C7 no room, unknown 39% in it, over 30% calls"),
        ("C7 unknown 92% in yellow frame, over 85% calls", "C7 no room, unknown 92% in yellow frame"),
        ("H9", "H9 no room"),
        ("", "no room"),
    ],
)
def test_that_there_is_no_room_is_told_before_the_answers_and_the_last_figure(text: str, told: str) -> None:
    assert texts.no_room(text) == told


@pytest.mark.parametrize("figure", [None, float("nan"), float("inf")])
def test_an_unknown_figure_shows_as_unknown(figure: float | None) -> None:
    assert texts.unknown_object(7, figure, 0.85, FRAME) == "C7 unknown thing ahead: go/stay/word"
    assert texts.unknown_object(7, 0.85, figure, FRAME) == "C7 unknown thing ahead: go/stay/word"
    assert texts.unknown_scene(8, figure, 0.9, 3) == "C8 new place: go/stay/word"
    assert texts.unknown_scene(8, 0.9, figure, 3) == "C8 new place: go/stay/word"


def test_a_long_word_is_cut_between_characters() -> None:
    assert notices.word_dropped("草" * 20) == "Too many words, out of use: " + "草" * 6 + "..."


def test_a_long_text_ends_behind_a_whole_word() -> None:
    why = '"xylophone" is not a word it knows: water, rock, road'
    assert notices.refused(why) == 'Refused: "xylophone" is not a word it knows:...'


def test_an_answer_to_the_current_one_while_nothing_is_open_names_no_id() -> None:
    assert texts.stale(0) == "No call or hold is open: nothing changed"
