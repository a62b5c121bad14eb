"""What goes through the channel comes out equal; what is no message is refused, and does nothing."""

from __future__ import annotations

import io
import os
import pickle
import random
import struct
import time
import tracemalloc
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from datetime import datetime, timezone
from functools import partial, reduce
from operator import getitem
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import Struct, msgpack, structs

from anytraverse.answers import MAX_EXAMPLES, AnswerOutcome
from anytraverse.assessment import Assessment, Observation
from anytraverse.errors import AnyTraverseError
from anytraverse.frame import Frame
from anytraverse.history import MAX_REFUSED, Entry, History, Match, Place
from anytraverse.judging import Settings, Thresholds
from anytraverse.memory import MOST_GIVEN, first_memory
from anytraverse.operations import ForgetCall, ForgetWord, NewEpisode, Operation, SetWord
from anytraverse.perception import Example
from anytraverse.preferences import MAX_WORDS, Preferences
from companion.cameras.newest import CameraState, CameraStatus
from companion.config import Config
from companion.system.atomic_write import write_atomically
from companion.vision.checks import BadReportError, Expected, check_report
from companion.vision.codec import (
    LARGEST,
    LARGEST_PACK,
    MOST_ARRAYS,
    CodecError,
    Splitter,
    decode,
    decode_trusted,
    encode,
    encode_trusted,
    pack,
)
from companion.vision.freeze_detector import luma
from companion.vision.memory_copy import MemoryCopy, parts, update_from, updated
from companion.vision.messages import (
    MOST_ROWS,
    Alive,
    Apply,
    Done,
    Draw,
    Drawn,
    Encode,
    Encoded,
    Failed,
    FrameJudged,
    Logged,
    MemoryUpdate,
    Model,
    Ready,
    Report,
    Request,
    Restore,
    Scenes,
    Start,
)
from companion.vision.worker import Worker
from companion.wire.ids import State
from tests.anytraverse.conftest import Painted
from tests.companion.daemon.rig import picture
from tests.companion.vision.played import WORDS, engine, heard, unframed

SETTINGS = Settings(thresholds=Thresholds(scene=0.9))


def plain(value: Any) -> Any:
    """What can be compared: fields by name, arrays as lists."""
    if isinstance(value, np.ndarray):
        return str(value.dtype), value.shape, value.tolist()
    if isinstance(value, Struct):
        return type(value).__name__, plain(structs.asdict(value))
    if isinstance(value, (tuple, list)):
        return [plain(one) for one in value]
    if isinstance(value, dict):
        return {key: plain(one) for key, one in value.items()}
    if hasattr(value, "__dict__") and not isinstance(value, type):
        return type(value).__name__, plain(vars(value))
    return repr(value)


def looked(thing: str = "", number: int = 1) -> FrameJudged:
    """A judged frame."""
    worker = Worker(engine(None), 1)
    return worker.judge(Frame(number, time.monotonic(), picture(thing)))


def told_of(update: MemoryUpdate) -> MemoryUpdate:
    """As it comes out."""
    read = heard(Done(1, None, "x", update)).update
    assert read is not None
    return read


STEPS = st.one_of(
    st.tuples(st.just("see"), st.sampled_from(["", "drum", "rock", "gnome"]), st.sampled_from([0, 40, 80])),
    st.tuples(st.just("word"), st.sampled_from(["drum", "trail", "lawn"]), st.sampled_from([-1.0, 0.5])),
    st.tuples(st.just("call"), st.sampled_from(["drum", "rock"]), st.integers(1, 5)),
    st.tuples(st.just("forget word"), st.sampled_from(["drum", "grass", "trail"]), st.just(0)),
    st.tuples(st.just("forget call"), st.just(""), st.integers(1, 5)),
    st.tuples(st.just("new episode"), st.just(""), st.just(0)),
)


@pytest.mark.slow
@settings(max_examples=60)
@given(st.lists(STEPS, max_size=12), st.integers(1, 4))
def test_the_supervisors_copy_equals_the_engines_memory_after_whatever_happened(
    steps: list[tuple[str, Any, Any]], limit: int
) -> None:
    perceiver = Painted()
    own = engine(first_memory(perceiver.model_id, WORDS, limit), perceiver)
    own.settings = SETTINGS
    copy, told, number = own.memory, own.memory, 0
    newest: Observation | None = None
    for what, word, value in steps:
        now = time.monotonic()
        operations: tuple[Operation, ...] = ()
        match what:
            case "see":
                number += 1
                newest = own.step(Frame(number, now, picture(word, scene=value)), now).observation
            case "word":
                operations = (SetWord(word, value),)
            case "call":
                operations = (SetWord(word, 1.0),)
            case "forget word":
                operations = (ForgetWord(word),)
            case "forget call":
                operations = (ForgetCall(value),)
            case _:
                operations = (NewEpisode(),)
        if operations:
            call, call_id = (newest, value) if what == "call" and newest is not None else (None, 0)
            try:
                own.answer(operations, now, call=call, call_id=call_id, go=call is not None)
            except AnyTraverseError:
                assert own.memory is told
        update = update_from(told, own.memory, 2, 1, ())
        assert len(update.entries) <= limit
        told = own.memory
        copy = updated(copy, told_of(update))
        assert plain(copy) == plain(own.memory)
    anew = updated(None, told_of(update_from(None, own.memory, 1, 0, ())))
    assert plain(anew) == plain(own.memory)


def test_what_did_not_change_does_not_travel() -> None:
    own = engine(None)
    now = time.monotonic()
    for number, scene in enumerate((0, 40, 80), 1):
        seen = own.step(Frame(number, now, picture(scene=scene)), now).observation
        own.answer((SetWord("trail", 1.0),), now, call=seen, call_id=number, go=True)
    before = own.memory
    own.answer((SetWord("drum", 1.0),), now)
    update = update_from(before, own.memory, 2, 1, ())
    assert update.entries == ()
    after = updated(before, update)
    assert all(one is other for one, other in zip(before.history, after.history, strict=True))


@pytest.mark.parametrize("thing", ["", "drum", "rock", "gnome"])
def test_an_assessment_comes_out_with_its_figures_and_maps_and_without_its_pixels(thing: str) -> None:
    said = looked(thing)
    told = heard(said)
    before, after = said.assessment, told.assessment
    assert after.reasons == before.reasons
    assert plain(after.findings) == plain(before.findings)
    assert plain(after.roi) == plain(before.roi)
    assert (after.frame.id, after.frame.captured_at) == (before.frame.id, before.frame.captured_at)
    assert after.frame.image.shape == before.frame.image.shape
    assert after.words.format() == before.words.format()
    assert after.maps is not None
    assert before.maps is not None
    assert (after.maps.signed == before.maps.signed).all()
    assert (after.maps.uncertainty == before.maps.uncertainty).all()
    assert after.maps.attention.size == 0
    assert after.observation is not None
    assert after.observation.features is None
    assert told.sectors == said.sectors


def test_a_message_of_a_large_picture_is_as_small_as_the_maps() -> None:
    big = np.zeros((2000, 3000, 3), np.uint8)
    seen = Assessment(Frame(1, 1.0, big), WORDS, (), 0.0)
    still = luma(big)
    assert len(encode(FrameJudged(seen, 1, 1.0, 0.1, (), still))) < still.nbytes + 2000


REPORTS: list[Report] = [
    Ready(
        Model("painted-1", "fp32", "why", int8_idle=True),
        SETTINGS,
        update_from(None, engine(None).memory, 1, 0, ("drum",)),
        ("a notice",),
        0.2,
    ),
    Failed("mend it"),
    Alive(CameraStatus(CameraState.FAILED, "why", 1, 2, 3, 4), 1.0),
    Alive(CameraStatus(), None),
    Drawn(1, 2, "title", b"panel", b"small", b"png", b"raw"),
    Encoded(1, 2, b"jpeg", b"png", b"png"),
    Logged(30, "a.name", "a text"),
    Done(1, None, "an error", None),
    Done(2, AnswerOutcome(None, None, ("word",), forgotten=(3,)), "", None),
    Scenes((Entry(np.ones(2, np.float32), WORDS, 1, 1),)),
]
REQUESTS: list[Request] = [
    Start(Config(), None, 0, 1),
    Start(Config(), engine(None).memory, 3, 9),
    Apply(1, (SetWord("drum", 1.0),), 2, 3, True, None),  # noqa: FBT003
    Restore(1, 2, b"png"),
    Draw(1, 2, "title", State.CALLING, store=True),
    Encode(1, 2),
]


@pytest.mark.parametrize("message", [*REPORTS, *REQUESTS], ids=lambda message: type(message).__name__)
def test_a_message_comes_out_as_it_went_in(message: Any) -> None:
    if isinstance(message, (Start, Apply, Restore, Draw, Encode)):
        (packed,) = Splitter().feed(encode_trusted(message))
        read: object = decode_trusted(packed)
    else:
        read = decode(unframed(message))
    assert plain(read) == plain(message)
    assert type(read) is type(message)


def with_pack(report: Report, change: Callable[[Any], object]) -> bytes:
    """Encoded, and its MessagePack changed: a list of the kind and the fields."""
    (length,) = struct.unpack_from("<I", whole := unframed(report))
    told = msgpack.decode(whole[4 : 4 + length])
    changed = change(told)
    packed = changed if isinstance(changed, bytes) else msgpack.encode(told)
    return struct.pack("<I", len(packed)) + packed + whole[4 + length :]


class Calls:
    """A pickle that has a function called."""

    def __init__(self, function: Callable[..., Any], *given: object) -> None:
        self.made = function, given

    def __reduce__(self) -> Any:
        return self.made


def dumped(value: object, protocol: int = 5) -> bytes:
    """A pickle without references, as those of the vision process are."""
    packed = io.BytesIO()
    pickler = pickle.Pickler(packed, protocol)
    pickler.fast = True
    pickler.dump(value)
    return packed.getvalue()


def named(module: str, name: str, then: bytes = b"") -> bytes:
    """A pickle that names anything, and goes on with `then`."""
    return f"c{module}\n{name}\n".encode() + then + b"."


def test_no_function_is_called_and_no_file_is_written(tmp_path: Path) -> None:
    path = tmp_path / "made"
    for called in (
        Calls(os.system, f"touch {path}"),
        Calls(write_atomically, path, b"x"),
        Calls(eval, f"open({str(path)!r}, 'w')"),
        Calls(exec, f"open({str(path)!r}, 'w')"),
        Calls(open, str(path), "w"),
        Calls(np.save, str(path), 1),
        Calls(getattr, 1, "real"),
        Calls(random.seed, 1),
        [Logged(1, "a", "b"), Calls(os.mkdir, str(path))],
    ):
        for protocol in range(2, 6):
            with pytest.raises(CodecError):
                decode(dumped(called, protocol))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "name",
    [
        ("os", "system"),
        ("builtins", "eval"),
        ("companion.system.atomic_write", "write_atomically"),
        ("companion.vision.codec", "struct"),
        ("companion.vision.codec", "decode_trusted"),
        ("companion.vision.codec", "pickle.loads"),
        ("companion.vision.messages", "Mapping"),
        ("companion.vision.messages", "updated"),
        ("numpy", "ndarray"),
        ("numpy.lib.npyio", "load"),
        ("functools", "partial"),
        ("anytraverse.assessment", "Assessment"),
    ],
)
def test_nothing_is_found_by_its_name_but_what_makes_data(name: tuple[str, str]) -> None:
    for told in (named(*name), pack([".".join(name), 1, 2]), pack([name[1], 1, 2]), pack([[*name], 1])):
        with pytest.raises(CodecError):
            decode(told)


def test_no_message_changes_a_class(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Assessment, "ok", Assessment.ok)
    own = Assessment.ok
    poison = b"N}X\x02\x00\x00\x00okX\x03\x00\x00\x00yess\x86b"  # the state that sets attributes
    for name in (("anytraverse.assessment", "Assessment"), ("companion.vision.codec", "pack")):
        with suppress(CodecError):
            decode(named(*name, poison))
    assert not hasattr(pack, "ok")
    poisoned = with_pack(looked(), lambda told: told[1].update(ok="yes", __class__="Frame", __init__="x"))
    with suppress(CodecError, BadReportError):
        read = decode(poisoned)
        assert isinstance(read, FrameJudged)
        assert read.assessment.ok is looked().assessment.ok
    assert Assessment.ok is own


def of_array(name: str, told: object) -> bytes:
    """A judged frame, one of whose maps is told like this."""
    return with_pack(looked(), lambda report: report[1]["maps"].update({name: told}))


def of_image(size: object) -> bytes:
    """A judged frame, whose picture is told to be of this size."""
    return with_pack(looked(), lambda report: report[1]["frame"].update(image=["|u1", size]))


def test_what_makes_data_makes_only_data() -> None:
    for array in (
        ["|O", [1]],
        ["<f8", [40, 60]],
        [">f4", [40, 60]],
        ["<f4", [1 << 40]],
        ["<f4", [1 << 25, 1 << 25]],
        ["<f4", [1 << 26] * 3],
        ["<f4", [40] * 4],
        ["<f4", [-1, 4]],
        ["<f4", [40.5, 60]],
        ["<f4", "40"],
        ["<f4"],
        "map",
        None,
        {"<f4": [40, 60]},
        [["<f4"], [40, 60]],
    ):
        with pytest.raises(CodecError):
            decode(of_array("signed", array))
    for size in ((0, 5, 3), (5, 1 << 20, 3), (-1, 4, 3), ("a", 4, 3), (4, 4), (4, 4, 4), (4, 4, 0)):
        with pytest.raises(CodecError):
            decode(of_image(size))


def test_an_array_whose_content_is_missing_is_refused() -> None:
    whole = unframed(looked())
    for missing in (1, 4, 2400, len(whole) // 2):
        with pytest.raises(CodecError):
            decode(whole[:-missing])


def test_a_bool_is_0_or_1_whatever_its_byte_is() -> None:
    (length,) = struct.unpack_from("<I", whole := unframed(looked()))
    read = decode(whole[: 4 + length] + b"\x07" * (len(whole) - 4 - length))
    assert isinstance(read, FrameJudged)
    assert read.assessment.maps is not None
    assert int(read.assessment.maps.known.sum()) == read.assessment.maps.known.size


def refused(packed: bytes) -> None:
    """Read and believed, or one of the two errors: nothing else."""
    with suppress(CodecError, BadReportError):
        check_report(decode(packed), Expected(0, {0: Settings()}), time.monotonic())


@given(st.binary(max_size=200))
def test_any_bytes_are_a_message_or_refused(packed: bytes) -> None:
    refused(packed)


DRUM = looked("drum")
WITH_MAPS = (DRUM, Done(2, AnswerOutcome(DRUM.assessment, DRUM.assessment), "", None))
SAMPLES = [unframed(one) for one in (*REPORTS, *WITH_MAPS)]


@pytest.mark.slow
@settings(max_examples=400)
@given(st.data())
def test_any_mutated_message_is_believed_or_refused(data: st.DataObject) -> None:
    packed = bytearray(data.draw(st.sampled_from(SAMPLES)))
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, min(len(packed), 1500) - 1))
        match data.draw(st.sampled_from(["set", "cut", "drop", "double"])):
            case "set":
                packed[at] = data.draw(st.integers(0, 255))
            case "cut" if at:
                del packed[at:]
            case "drop" if len(packed) > 1:
                del packed[at]
            case _:
                packed[at:at] = packed[at : at + 20]
    began = time.thread_time()
    refused(bytes(packed))
    assert time.thread_time() - began < 0.5


VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats()
    | st.text(max_size=5)
    | st.binary(max_size=5)
    | st.builds(msgpack.Ext, st.integers(-128, 127), st.binary(max_size=5)),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


def places(told: Any) -> list[tuple[Any, Any]]:
    """Each value in it: what contains it, and at which index or key."""
    inner = told.items() if isinstance(told, dict) else enumerate(told) if isinstance(told, list) else ()
    return [found for at, value in inner for found in ((told, at), *places(value))]


@pytest.mark.slow
@settings(max_examples=400)
@given(st.sampled_from((*REPORTS, *WITH_MAPS)), st.data())
def test_any_value_in_the_place_of_another_is_believed_or_refused(
    report: Report, data: st.DataObject
) -> None:
    def change(told: list[Any]) -> None:
        within, at = data.draw(st.sampled_from(places(told)))
        within[at] = data.draw(VALUES)

    refused(with_pack(report, change))


def without(told: Any, at: Any) -> None:
    del told[at]


def deep(brackets: int) -> bytes:
    """A features, which may be anything, of nested lists."""
    return b"\xa8features" + b"\x91" * brackets + b"\xc0"


def spliced(old: bytes, new: bytes) -> bytes:
    """A judged frame, a few bytes of its MessagePack exchanged."""
    (length,) = struct.unpack_from("<I", whole := unframed(looked()))
    packed = whole[4 : 4 + length]
    assert packed.count(old) == 1
    packed = packed.replace(old, new)
    return struct.pack("<I", len(packed)) + packed + whole[4 + length :]


NOT_READ: dict[str, bytes] = {
    "nested deeply": spliced(b"\xa8features\xc0", deep(100_000)),
    "nested deeply in a field that is none": spliced(
        b"\xa9undecided\xc2", b"\xa9undecidee" + deep(100_000)[9:]
    ),
    "nested deeply, alone": pack(0)[:4] + b"\x91" * 100_000,
    "a list of 4 billion": spliced(b"\xa8features\xc0", b"\xa8features\xdd\xff\xff\xff\xff"),
    "a map of 4 billion": spliced(b"\xa8features\xc0", b"\xa8features\xdf\xff\xff\xff\xff"),
    "bytes of 4 billion": spliced(b"\xa8features\xc0", b"\xa8features\xc6\xff\xff\xff\xff"),
    "a text of 4 billion": spliced(b"\xa8features\xc0", b"\xa8features\xdb\xff\xff\xff\xff"),
    "an extension of 4 billion": spliced(b"\xa8features\xc0", b"\xa8features\xc9\xff\xff\xff\xff\x01"),
    "a length beyond the message": struct.pack("<I", 1 << 31) + unframed(looked())[4:],
    "no length": b"\x01",
    "a text that is no UTF-8": pack(["Failed", "abc"]).replace(b"abc", b"a\xff\xfe"),
    "a kind that is no UTF-8": pack(["Failed", "abc"]).replace(b"Failed", b"Faile\xff"),
    "an extension": pack(["Failed", msgpack.Ext(1, b"text")]),
    "a date": pack(["Logged", 30, "name", datetime(2026, 1, 1, tzinfo=timezone.utc)]),
    "an integer of 64 bits below 0": pack(["Logged", -(2**63), "name", "text"]),
    "no kind": pack([]),
    "another kind": pack(["Closed", "text"]),
    "a kind that is a number": pack([1, "text"]),
    "a request": pack(["Encode", 1, 2]),
    "a part of a report": pack(["MemoryUpdate", 1, 0, None, [], [], []]),
    "a map": pack({"type": "Failed", "text": "text"}),
    "a field too few": pack(["Logged", 30, "name"]),
    "a field too many": pack(["Logged", 30, "name", "text", 1]),
    "a second report": pack(["Failed", "text"]) + pack(["Failed", "text"])[4:],
    "a field of a part missing": with_pack(looked(), lambda told: without(told[1], "age")),
    "a key that is a number": with_pack(looked(), lambda told: told[1].update({7: 7})),
}


@pytest.mark.parametrize("packed", NOT_READ.values(), ids=NOT_READ)
def test_what_messagepack_allows_and_no_report_has_is_refused(packed: bytes) -> None:
    began = time.thread_time()
    with pytest.raises(CodecError):
        decode(packed)
    assert time.thread_time() - began < 0.5


@pytest.mark.parametrize(
    "told",
    [
        pack(["no\nkind \x1b[2J" * 9000, 1]),
        of_array("signed", ["<f4\n\x1b" * 9000, [40, 60]]),
        pack(["Alive", {"state": "no\nstate \x1b[2J" * 9000}, None]),
    ],
)
def test_what_it_says_of_nonsense_is_short_and_controls_no_terminal(told: bytes) -> None:
    with pytest.raises(CodecError) as caught:
        decode(told)
    assert len(str(caught.value)) < 300
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("key", [b"undecidee", b"undecide\xff"])
def test_a_field_of_a_part_that_nobody_knows_is_in_the_place_of_one_that_is_left_out(key: bytes) -> None:
    with pytest.raises(CodecError):
        decode(spliced(b"\xa9undecided\xc2", b"\xa9" + key + b"\xc3"))


@pytest.mark.parametrize("field", ["findings", "similarity", "undecided", "maps", "roi"])
def test_a_field_of_a_part_that_is_left_out_has_no_default(field: str) -> None:
    with pytest.raises(CodecError):
        decode(with_pack(looked("drum"), lambda told: without(told[1], field)))


SCENES = Scenes((Entry(np.ones(2, np.float32), WORDS, 1, 1),))


@pytest.mark.parametrize(
    ("report", "path", "names"),
    [
        (SCENES, (1, 0), ("examples", "place", "refused", "surroundings")),
        (REPORTS[0], (2,), ("region", "thresholds", "corridor", "votes")),
        (REPORTS[0], (3, 3), ("preferences", "configured", "examples", "settled", "given", "history")),
        (REPORTS[0], (1,), (-1,)),
        (REPORTS[4], (), (-1,)),
        (REPORTS[7], (), (-1,)),
        (DRUM, (), (-1,)),
    ],
)
def test_no_field_takes_its_default_where_it_is_left_out(
    report: Report, path: tuple[int, ...], names: tuple[Any, ...]
) -> None:
    def leave_out(name: Any, told: Any) -> None:
        del reduce(getitem, path, told)[name]

    for name in names:
        with pytest.raises(CodecError):
            decode(with_pack(report, partial(leave_out, name)))


@pytest.mark.parametrize("second", [b"\xc3", b"\x01"])
def test_a_key_that_stands_twice_in_the_place_of_another_is_refused(second: bytes) -> None:
    with pytest.raises(CodecError):
        decode(spliced(b"\xa9undecided\xc2\xa8likeness\xc0", b"\xa9undecided\xc2\xa9undecided" + second))


@given(st.lists(st.binary(min_size=0, max_size=50), max_size=5), st.integers(1, 20))
def test_a_stream_is_cut_into_the_messages_however_it_arrives(messages: list[bytes], size: int) -> None:
    stream = b"".join(len(one).to_bytes(4, "little") + one for one in messages)
    splitter, found = Splitter(), []
    for start in range(0, len(stream), size):
        found += splitter.feed(stream[start : start + size])
    assert found == messages


def test_a_message_that_would_be_too_long_is_refused_by_its_length_alone() -> None:
    with pytest.raises(CodecError, match="at most"):
        Splitter().feed((LARGEST + 1).to_bytes(4, "little"))
    with pytest.raises(CodecError, match="at most"):
        encode(Drawn(1, 1, "t", b"x" * (LARGEST + 1)))


def tapped(order: int, taps: int = MAX_EXAMPLES) -> Entry:
    """A scene of which everything is known, with as many words, taps and refused frames as there may be."""
    vector = np.random.default_rng(order).random(384, np.float32)
    words = Preferences.of({f"word number {number}": 1.0 for number in range(MAX_WORDS)}, order)
    examples = {word: (Example("painted", vector),) * taps for word in words}
    place = Place(47.1, 8.2, 90.0, 1.7e9, (0.1, 0.2, 0.3))
    return Entry(vector, words, order, order, order, examples, place, (vector,) * MAX_REFUSED, vector)


@pytest.mark.slow
def test_the_largest_report_of_the_engine_is_read() -> None:
    memory = first_memory("painted", WORDS, 10_000)
    before = replace(memory, history=History([tapped(n, 0) for n in range(1, 10_001)], 10_000))
    rows = [tapped(n) for n in range(20_001, 20_001 + MOST_ROWS)]
    given_words = {f"word {number}": 1.0 for number in range(MOST_GIVEN)}
    settled = dict.fromkeys(given_words, 1)
    history = History(rows, 10_000)
    after = replace(memory, history=history, examples=rows[0].examples, given=given_words, settled=settled)
    seen = looked("drum")
    adopted = replace(seen.assessment, adopted=rows[0], match=Match(rows[1], 0.9))
    update = update_from(before, after, 2, 1, ())
    packed = unframed(structs.replace(seen, assessment=adopted, update=update))
    assert int.from_bytes(packed[:4], "little") < LARGEST_PACK / 2
    assert len(update.removed) == 10_000
    read = decode(packed)
    assert isinstance(read, FrameJudged)
    assert plain(read.update) == plain(update)


def test_a_report_of_more_than_there_is_time_for_is_refused() -> None:
    def failed(size: int) -> bytes:
        packed = msgpack.encode(["Failed", ""])
        return (
            struct.pack("<I", size)
            + packed[:-1]
            + b"\xdb"
            + (size - 13).to_bytes(4, "big")
            + b"x" * (size - 13)
        )

    with pytest.raises(CodecError, match="length <= 4096"):
        decode(failed(LARGEST_PACK))
    with pytest.raises(CodecError, match="Invalid value 'Failed'"):
        decode(failed(LARGEST_PACK + 1))
    large = Drawn(1, 1, "t", b"x" * (LARGEST_PACK + 1))
    assert heard(large) == large


def test_a_report_of_more_arrays_than_there_is_time_for_is_refused() -> None:
    def scenes(arrays: int) -> bytes:
        row = replace(tapped(1, 0), refused=(), surroundings=None)
        example = Example("", np.zeros(0, np.float32))
        return unframed(Scenes((replace(row, examples={"drum": (example,) * (arrays - 1)}),)))

    decode(scenes(MOST_ARRAYS))
    with pytest.raises(CodecError, match="arrays"):
        decode(scenes(MOST_ARRAYS + 1))


def hostile(kind: str) -> bytes:
    """As many small values as a report may have."""
    count = LARGEST_PACK - 4000
    if kind in ("removed", "weak"):
        update = update_from(None, engine(None).memory, 1, 0, ())
        many: dict[str, Any] = {"removed": (0,) * count, "weak": ("",) * count}
        return unframed(Done(1, None, "x", structs.replace(update, **{kind: many[kind]})))
    given_values: dict[str, Any] = {
        "lists": [[]] * count,
        "maps": [{}] * count,
        "nested lists": [[[[[]]]]] * (count // 4),
        "maps of lists": [{"a": []}] * (count // 4),
        "extensions": [msgpack.Ext(1, b"")] * (count // 3),
    }
    return with_pack(looked(), lambda told: told[1]["observation"].update(features=given_values[kind]))


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind", ["removed", "weak", "lists", "maps", "nested lists", "maps of lists", "extensions"]
)
def test_as_many_small_values_as_a_report_may_have_take_neither_seconds_nor_memory(kind: str) -> None:
    packed = hostile(kind)
    tracemalloc.start()
    try:
        refused(packed)
        assert tracemalloc.get_traced_memory()[1] < 64 << 20
    finally:
        tracemalloc.stop()
    began = time.thread_time()
    refused(packed)
    assert time.thread_time() - began < 0.5


def test_a_few_bytes_do_not_stand_for_millions_of_scenes() -> None:
    update = update_from(None, replace(engine(None).memory, history=History([tapped(1)])), 1, 0, ())
    many = structs.replace(update, entries=update.entries * 1_000_000)
    with pytest.raises(CodecError):
        decode(pickle.dumps(Done(1, None, "x", many)))
    with pytest.raises(CodecError, match=f"length <= {MOST_ROWS}"):
        told_of(structs.replace(update, entries=update.entries * (MOST_ROWS + 1)))


@pytest.mark.parametrize("count", [0, 1, MOST_ROWS, MOST_ROWS + 1, 30])
def test_an_update_of_many_rows_comes_in_parts_and_whole(count: int) -> None:
    after = replace(engine(None).memory, history=History([tapped(n, 1) for n in range(1, 1 + count)]))
    copy = MemoryCopy(None, 256)
    for part in map(heard, parts(Done(1, None, "x", update_from(None, after, 1, 0, ())))):
        if isinstance(part, Scenes):
            copy.add(part.entries)
        elif isinstance(part, Done) and part.update is not None:
            copy.apply(part.update)
    assert copy.memory is not None
    assert plain(list(copy.memory.history)) == plain(list(after.history))


@pytest.mark.parametrize("most", [256, 10_000])
def test_the_rows_of_one_update_have_an_end_and_a_new_process_begins_without_them(most: int) -> None:
    copy = MemoryCopy(None, most)
    row = tapped(1, 0)
    for _ in range(2):
        copy.add((row,) * most)
        with pytest.raises(BadReportError, match="rows of one update"):
            copy.add((row,))
        copy.first_part()


def test_a_memory_of_more_scenes_than_are_configured_is_refused() -> None:
    copy = MemoryCopy(None, 256)
    memory = replace(engine(None).memory, history=History((), 257))
    with pytest.raises(BadReportError, match="257 scenes"):
        copy.apply(update_from(None, memory, 1, 0, ()))
    assert copy.memory is None


def test_an_update_says_what_it_removed() -> None:
    own = engine(None)
    now = time.monotonic()
    seen = own.step(Frame(1, now, picture()), now).observation
    own.answer((SetWord("trail", 1.0),), now, call=seen, call_id=4, go=True)
    before = own.memory
    (kept,) = [entry.order for entry in before.history if entry.call_id == 4]
    own.answer((ForgetCall(4),), now)
    update = update_from(before, own.memory, 2, 1, ())
    assert isinstance(update, MemoryUpdate)
    assert update.removed == (kept,)


def test_a_few_bytes_take_neither_seconds_nor_memory() -> None:
    itself = b")" + b"2\x86" * 64
    shared = b")\x94" + b"".join(b"h" + bytes([at]) + b"\x86\x94" for at in range(64))
    began = time.perf_counter()
    for hostile in (
        b"\x80\x05Nr\xff\xff\xff\x0f.",
        b"\x80\x05}" + itself + b"Ns.",
        b"\x80\x05}" + shared + b"Ns.",
        b"\x80\x05}(" + shared + b"Nu.",
        b"\x80\x05\x8f(" + shared + b"\x90.",
        named("companion.vision.codec", "pack", b"X\x14\x00\x00\x00anytraverse.assessment"),
    ):
        with pytest.raises(CodecError):
            decode(hostile)
    assert time.perf_counter() - began < 1.0


@pytest.mark.parametrize("number", [np.float64(0.5), np.float32(0.5), np.int64(7), np.bool_(True)])  # noqa: FBT003
def test_a_number_of_numpys_comes_out_as_pythons(number: Any) -> None:
    (read,) = msgpack.decode(pack([number])[4:])
    assert read == number.item()
    assert type(read) is type(number.item())
