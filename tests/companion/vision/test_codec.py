"""What goes through the channel comes out equal; what is no message is refused, and does nothing."""

from __future__ import annotations

import io
import os
import pickle
import pickletools
import random
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.answers import MAX_EXAMPLES, Changes
from anytraverse.assessment import Assessment, Observation
from anytraverse.errors import AnyTraverseError
from anytraverse.frame import Frame
from anytraverse.history import MAX_REFUSED, Entry, History, Match, Place
from anytraverse.judging import Settings, Thresholds
from anytraverse.memory import MOST_GIVEN, first_memory
from anytraverse.perception import Example
from anytraverse.preferences import MAX_WORDS, Preferences
from companion.cameras.newest import CameraState, CameraStatus
from companion.config import Config
from companion.system.atomic_write import write_atomically
from companion.vision.checks import BadReportError, Expected, check_report
from companion.vision.codec import (
    LARGEST,
    MOST_OPCODES,
    CodecError,
    Splitter,
    array_of,
    decode,
    decode_trusted,
    encode,
    encode_trusted,
    frame_of_size,
    made,
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
    Restore,
    Scenes,
    Start,
)
from companion.vision.worker import Worker
from companion.wire.ids import State
from tests.anytraverse.conftest import Painted
from tests.companion.daemon.rig import picture
from tests.companion.vision.played import WORDS, engine

SETTINGS = Settings(thresholds=Thresholds(scene=0.9))


def unframed(message: object) -> bytes:
    """Encoded, without the length."""
    (packed,) = Splitter().feed(encode(message))
    return packed


def through(message: Any) -> Any:
    """As the supervisor reads it, where it believes it."""
    return check_report(decode(unframed(message)), Expected(0), time.monotonic())


def plain(value: Any) -> Any:
    """What can be compared: fields by name, arrays as lists."""
    if isinstance(value, np.ndarray):
        return str(value.dtype), value.shape, value.tolist()
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


STEPS = st.one_of(
    st.tuples(st.just("see"), st.sampled_from(["", "drum", "rock", "gnome"]), st.sampled_from([0, 40, 80])),
    st.tuples(st.just("word"), st.sampled_from(["drum", "trail", "lawn"]), st.sampled_from([-1.0, 0.5])),
    st.tuples(st.just("call"), st.sampled_from(["drum", "rock"]), st.integers(1, 5)),
    st.tuples(st.just("forget word"), st.sampled_from(["drum", "grass", "trail"]), st.just(0)),
    st.tuples(st.just("forget call"), st.just(""), st.integers(1, 5)),
    st.tuples(st.just("new episode"), st.just(""), st.just(0)),
)


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
        changes = None
        match what:
            case "see":
                number += 1
                newest = own.step(Frame(number, now, picture(word, scene=value)), now).observation
            case "word":
                changes = Changes({word: value})
            case "call":
                changes = Changes({word: 1.0})
            case "forget word":
                changes = Changes(forget_words=(word,))
            case "forget call":
                changes = Changes(forget_calls=(value,))
            case _:
                changes = Changes(new_episode=True)
        if changes is not None:
            call, call_id = (newest, value) if what == "call" and newest is not None else (None, 0)
            try:
                own.answer(changes, now, call=call, call_id=call_id, go=call is not None)
            except AnyTraverseError:
                assert own.memory is told
        update = update_from(told, own.memory, 2, 1, ())
        assert len(update.entries) <= limit
        told = own.memory
        copy = updated(copy, decode(unframed(update)))
        assert plain(copy) == plain(own.memory)
    anew = updated(None, decode(unframed(update_from(None, own.memory, 1, 0, ()))))
    assert plain(anew) == plain(own.memory)


def test_what_did_not_change_does_not_travel() -> None:
    own = engine(None)
    now = time.monotonic()
    for number, scene in enumerate((0, 40, 80), 1):
        seen = own.step(Frame(number, now, picture(scene=scene)), now).observation
        own.answer(Changes({"trail": 1.0}), now, call=seen, call_id=number, go=True)
    before = own.memory
    own.answer(Changes({"drum": 1.0}), now)
    update = update_from(before, own.memory, 2, 1, ())
    assert update.entries == ()
    after = updated(before, update)
    assert all(one is other for one, other in zip(before.history, after.history, strict=True))


@pytest.mark.parametrize("thing", ["", "drum", "rock", "gnome"])
def test_an_assessment_comes_out_with_its_figures_and_maps_and_without_its_pixels(thing: str) -> None:
    said = looked(thing)
    heard = through(said)
    before, after = said.assessment, heard.assessment
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
    assert heard.sectors == said.sectors


def test_a_message_of_a_large_picture_is_as_small_as_the_maps() -> None:
    big = np.zeros((2000, 3000, 3), np.uint8)
    seen = Assessment(Frame(1, 1.0, big), WORDS, (), 0.0)
    still = luma(big)
    assert len(encode(FrameJudged(seen, 1, 1.0, 0.1, (), still))) < still.nbytes + 2000


MESSAGES = [
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
    Start(Config(), None, 0, 1),
    Start(Config(), engine(None).memory, 3, 9),
    Apply(1, Changes({"drum": 1.0}), 2, 3, True, None),  # noqa: FBT003
    Restore(1, 2, b"png"),
    Draw(1, 2, "title", State.CALLING, store=True),
    Encode(1, 2),
]


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
def test_a_message_comes_out_as_it_went_in(message: Any) -> None:
    packed = unframed(message)
    read = decode_trusted if isinstance(message, (Start, Apply, Restore, Draw, Encode)) else decode
    assert plain(read(packed)) == plain(message)
    assert type(read(packed)) is type(message)


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
        ("companion.vision.codec", "importlib"),
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
    with pytest.raises(CodecError):
        decode(named(*name))


def test_no_message_changes_a_class(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Assessment, "ok", Assessment.ok)
    own = Assessment.ok
    poison = b"N}X\x02\x00\x00\x00okX\x03\x00\x00\x00yess\x86b"  # the state that sets attributes
    for name in (("anytraverse.assessment", "Assessment"), ("companion.vision.codec", "made")):
        with suppress(CodecError):
            decode(named(*name, poison))
    assert Assessment.ok is own
    assert not hasattr(made, "ok")


def test_what_makes_data_makes_only_data() -> None:
    for module, name, content in (
        ("os", "system", "true"),
        ("companion.vision.messages", "updated", {}),
        ("companion.vision.messages", "Any", {}),
        ("anytraverse.judging", "math", {}),
        ("companion.vision.client", "VisionClient", {}),
        ("companion.cameras.newest", "CameraThread", {}),
    ):
        with pytest.raises(CodecError, match="no data"):
            decode(dumped(Calls(made, module, name, content)))
    for array in (("|O", (1,), b"12345678"), ("<f4", (1 << 40,), b""), ("<f4", (2,), b"123")):
        with pytest.raises(CodecError):
            decode(dumped(Calls(array_of, *array)))
    for size in ((0, 5), (5, 1 << 20), (-1, 4), ("a", 4)):
        with pytest.raises(CodecError):
            decode(dumped(Calls(frame_of_size, 1, 0.0, *size)))


def refused(packed: bytes) -> None:
    """Read and believed, or one of the two errors: nothing else."""
    with suppress(CodecError, BadReportError):
        check_report(decode(packed), Expected(0), time.monotonic())


@given(st.binary(max_size=200))
def test_any_bytes_are_a_message_or_refused(packed: bytes) -> None:
    refused(packed)


SAMPLES = [unframed(one) for one in (*MESSAGES[:6], looked("drum"))]


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
    refused(bytes(packed))


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
    judged = replace(seen, assessment=adopted, update=update_from(before, after, 2, 1, ()))
    packed = unframed(judged)
    assert sum(1 for _ in pickletools.genops(packed)) < MOST_OPCODES
    read = decode(packed)
    assert len(read.update.removed) == 10_000
    assert plain(read.update.entries) == plain(tuple(rows))


def test_a_report_of_more_than_there_is_time_for_is_refused() -> None:
    def nones(opcodes: int) -> bytes:
        return b"\x80\x05(" + (opcodes - 4) * b"N" + b"t."

    assert len(decode(nones(MOST_OPCODES))) == MOST_OPCODES - 4
    with pytest.raises(CodecError, match="opcodes"):
        decode(nones(MOST_OPCODES + 1))


def test_a_few_bytes_do_not_stand_for_millions_of_scenes() -> None:
    update = update_from(None, replace(engine(None).memory, history=History([tapped(1)])), 1, 0, ())
    many = replace(update, entries=update.entries * 1_000_000)
    with pytest.raises(CodecError):
        decode(encode_trusted(Done(1, None, "x", many))[4:])
    with pytest.raises(BadReportError, match="rows"):
        through(Done(1, None, "x", replace(update, entries=update.entries * (MOST_ROWS + 1))))


@pytest.mark.parametrize("count", [0, 1, MOST_ROWS, MOST_ROWS + 1, 30])
def test_an_update_of_many_rows_comes_in_parts_and_whole(count: int) -> None:
    after = replace(engine(None).memory, history=History([tapped(n, 1) for n in range(1, 1 + count)]))
    copy = MemoryCopy(None)
    for part in map(through, parts(Done(1, None, "x", update_from(None, after, 1, 0, ())))):
        if isinstance(part, Scenes):
            copy.add(part.entries)
        else:
            copy.apply(part.update)
    assert copy.memory is not None
    assert plain(list(copy.memory.history)) == plain(list(after.history))


def test_the_rows_of_one_update_have_an_end_and_a_new_process_begins_without_them() -> None:
    copy = MemoryCopy(None)
    row = tapped(1, 0)
    for _ in range(2):
        copy.add((row,) * 10_000)
        with pytest.raises(BadReportError, match="rows of one update"):
            copy.add((row,))
        copy.first_part()


def test_an_update_says_what_it_removed() -> None:
    own = engine(None)
    now = time.monotonic()
    seen = own.step(Frame(1, now, picture()), now).observation
    own.answer(Changes({"trail": 1.0}), now, call=seen, call_id=4, go=True)
    before = own.memory
    (kept,) = [entry.order for entry in before.history if entry.call_id == 4]
    own.answer(Changes(forget_calls=(4,)), now)
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
        named("companion.vision.codec", "made", b"X\x14\x00\x00\x00anytraverse.assessment"),
    ):
        with pytest.raises(CodecError):
            decode(hostile)
    assert time.perf_counter() - began < 1.0


@pytest.mark.parametrize("number", [np.float64(0.5), np.float32(0.5), np.int64(7), np.bool_(True)])  # noqa: FBT003
def test_a_number_of_numpys_comes_out_as_pythons(number: Any) -> None:
    read = decode(unframed([number]))
    assert read == [number.item()]
    assert type(read[0]) is type(number.item())
