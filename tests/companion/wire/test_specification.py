"""docs/protocol.md against the code: what it prints, its worked examples, and the client written from it."""

import importlib.util
import re
import struct
import subprocess
import sys
import time
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from anytraverse.operations import SetWord, Tap
from companion.link.answers import _COMMAND_RESULTS
from companion.wire import layouts, refusals
from companion.wire.answers import Acknowledgement, Answer
from companion.wire.call_report import CallReport
from companion.wire.doc_generator import numbers_markdown
from companion.wire.ids import (
    TUNNEL_ACKNOWLEDGEMENT,
    TUNNEL_CALL,
    TUNNEL_SUMMARY,
    Kind,
    Motion,
    Outcome,
    Policy,
    Reasons,
    Result,
    Stage,
    State,
    words_hash,
)
from companion.wire.payloads import Summary

DOCS = Path(__file__).resolve().parents[3] / "docs"
PAGE = (DOCS / "protocol.md").read_text()
_CODES = {"u8": "B", "u16": "H", "u32": "I", "i16": "h", "i32": "i"}
_LINE = re.compile(r"^ *(\d+)  ((?:[0-9a-f]{2} ?)+)  (.+?) = (.+)$", re.MULTILINE)

BEFORE = {"grass": 1.0, "dirt path": 1.0, "bush": -1.0}
BOX = (0.45, 0.62, 0.55, 0.78)
EXAMPLES: dict[str, Summary | CallReport | Answer | Acknowledgement] = {
    "Summary, 45001": Summary(
        state=State.CALLING,
        policy=Policy.HOLD,
        reasons=Reasons.UNKNOWN_OBJECT,
        sequence=1207,
        current_id=7,
        frame_id=48213,
        frame_age_ms=140,
        latency_ms=96,
        roi_traversability=0.5821,
        roi_uncertainty=0.3804,
        worst_tile=0.9312,
        similarity=0.9127,
        field_of_view=69,
        words=words_hash(BEFORE),
        dropped=2,
        sectors=(*[None] * 2, *[1.0] * 5, 0.4, 0.0, 0.25, *[1.0] * 4, *[None] * 2),
    ),
    "Call or hold, 45002": CallReport(
        id=7,
        kind=Kind.CALL,
        stage=Stage.OPEN,
        outcome=Outcome.NONE,
        reasons=Reasons.UNKNOWN_OBJECT,
        holding=True,
        test=False,
        frame_id=48197,
        age_s=12,
        roi=(0.333, 0.6, 0.667, 0.95),
        worst_tile_box=BOX,
        roi_uncertainty=0.3804,
        worst_tile=0.9312,
        drivable_share=0.5821,
        similarity=0.9127,
        latitude=47.3769,
        longitude=-8.5417,
        heading=271.5,
        word_count=3,
        words=words_hash(BEFORE),
        picture="/calls/7.jpg",
    ),
    "Answering by program, 45003": Answer(
        7, Motion.GO, (SetWord("gravel", 0.8), Tap(48197, BOX, "drum", -1.0)), 0x1F2E3D4C
    ),
    "Acknowledgement, 45004": Acknowledgement(
        transaction=0x1F2E3D4C,
        target=7,
        result=Result.APPLIED,
        stage=Stage.ANSWERED,
        outcome=Outcome.NONE,
        roi_uncertainty=0.0312,
        worst_tile=0.0744,
        reasons=Reasons.NONE,
        words=words_hash(BEFORE | {"gravel": 0.8, "drum": -1.0}),
        text="C7 go given: waiting for a clear view",
    ),
}


def section(title: str) -> str:
    return PAGE.split(f"\n## {title}\n")[1].split("\n## ")[0]


def types_on_the_page(text: str) -> dict[str, str]:
    """Field -> type, as the tables of a section say."""
    rows = re.findall(r"^\| \d+ \| [^|]+ \| ([a-z0-9\[\]]+) \| ([^|]+) \|", text, re.MULTILINE)
    return {field.strip(): kind for kind, field in rows}


def figure(kind: str, raw: bytes) -> str:
    if kind == "text":
        assert raw[0] == len(raw) - 1
        return f'"{raw[1:].decode()}"'
    base, _, count = kind.rstrip("]").partition("[")
    return " ".join(map(str, struct.unpack(f"<{count}{_CODES[base]}", raw)))


@pytest.mark.parametrize("title", EXAMPLES)
def test_every_byte_of_an_example_reads_as_the_tables_say_and_is_what_the_code_packs(title: str) -> None:
    text = section(title)
    types = types_on_the_page(text) | {"operation": "u8"}
    payload = b""
    for offset, hexadecimal, field, told in _LINE.findall(text):
        assert int(offset) == len(payload), field
        raw = bytes.fromhex(hexadecimal)
        assert figure(types[field], raw) == told, field
        payload += raw
    assert payload == EXAMPLES[title].pack()
    made = type(EXAMPLES[title]).unpack(payload)
    assert made == ((EXAMPLES[title], 0, 1) if isinstance(made, tuple) else EXAMPLES[title])


def test_the_page_shows_layouts_numbers_and_refusals_as_they_are() -> None:
    tables = [layouts.SUMMARY, layouts.CALL, layouts.ANSWER, layouts.ACKNOWLEDGEMENT, layouts.FILE_TRANSFER]
    tables += [one for one in layouts.OPERATIONS.values() if one.fields]
    for layout in tables:
        assert layout.markdown() in PAGE, layout.title
    assert numbers_markdown() in PAGE
    assert refusals.counted_markdown() in PAGE
    assert refusals.texts_markdown() in PAGE


def test_the_page_tells_what_becomes_of_an_answer_as_command_and_as_data() -> None:
    rows = re.findall(
        r"^\| (\d) ([a-z ]+) \| (\d) [A-Z_]+ \|", section("Acknowledgement, 45004"), re.MULTILINE
    )
    told = {Result(int(number)): (name, int(command)) for number, name, command in rows}
    assert told == {
        result: (result.name.lower().replace("_", " "), command)
        for result, command in _COMMAND_RESULTS.items()
    }


def test_the_page_tells_how_words_are_summed_up() -> None:
    weights, text, crc = re.search(r"With (.+?) it is that of\s+`(.+?)`, ([0-9A-F]{8})", PAGE).groups()  # type: ignore[union-attr]
    assert (weights, text) == ("grass 1 and bush -0.5", "bush:-5000;grass:10000")
    assert int(crc, 16) == words_hash({"grass": 1.0, "bush": -0.5})


def test_every_link_inside_the_page_leads_to_a_heading() -> None:
    headings = re.findall(r"^##+ (.+)$", PAGE, re.MULTILINE)
    anchors = {re.sub(r"[^a-z0-9 -]", "", title.lower()).replace(" ", "-") for title in headings}
    assert set(re.findall(r"\]\(#([^)]+)\)", PAGE)) <= anchors


def test_the_module_prints_each_page_and_names_them() -> None:
    def run(*arguments: str) -> Any:
        command = [sys.executable, "-m", "companion.wire", *arguments]
        return subprocess.run(
            command, check=False, capture_output=True, text=True, timeout=30, cwd=DOCS.parent
        )

    assert run("layouts").stdout == layouts.markdown()
    refused = run("nothing")
    assert refused.returncode == 1
    assert "messages, parameters, layouts, numbers, refusals" in refused.stderr


@pytest.fixture(scope="module")
def client() -> ModuleType:
    """The client written from the page alone."""
    spec = importlib.util.spec_from_file_location("answer_from_python", DOCS / "answer_from_python.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MAVLINK20", "1")  # as it does itself, and taken back behind it
        spec.loader.exec_module(module)
    return module


def test_the_client_reads_what_the_code_packs(client: ModuleType) -> None:
    summary, call, _, acknowledgement = EXAMPLES.values()
    told = client.read(TUNNEL_SUMMARY, summary.pack())
    assert (told["state"], told["id"], told["uncertainty"]) == ("calling", 7, 0.3804)
    assert told["sectors"][0] is None
    assert told["sectors"][7] == 0.4
    told = client.read(TUNNEL_CALL, call.pack())
    assert (told["id"], told["frame"], told["picture"]) == (7, 48197, "/calls/7.jpg")
    assert told["box"] == list(BOX)
    told = client.read(TUNNEL_ACKNOWLEDGEMENT, acknowledgement.pack())
    assert (told["transaction"], told["result"]) == (0x1F2E3D4C, "applied")
    assert told["text"] == "C7 go given: waiting for a clear view"
    with pytest.raises(ValueError, match="version 9"):
        client.read(TUNNEL_CALL, b"\x09" + call.pack()[1:])


def test_the_code_reads_what_the_client_packs(client: ModuleType) -> None:
    payload = client.pack_answer(5, 7, 1, {"gravel": 0.8, "Gestrüpp": -1.0})
    words = (SetWord("gravel", 0.8), SetWord("Gestrüpp", -1.0))
    assert Answer.unpack(payload) == (Answer(7, Motion.GO, words, 5), 0, 1)


def test_the_client_sends_a_line_that_turns_a_sign_only_when_it_is_repeated(
    client: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    rover = object.__new__(client.Client)
    rover.heard_at, rover.turning = time.monotonic(), ""
    sent: list[object] = []
    state = '{"words": {"old water": -1, "grass": 1}, "given": {"mud": -0.5}}'
    monkeypatch.setattr(rover, "get", lambda _path: state)

    def send(*what: Any) -> Any:
        sent.append(what)
        return "applied" if isinstance(what[1], dict) else what[1]

    monkeypatch.setattr(rover, "answer", send)
    monkeypatch.setattr(rover, "set", send)
    assert rover.obey("go old water 1") == "old water was -1: repeat it to turn it"
    assert rover.obey("go old water -0.5") == "applied"
    assert rover.obey("word mud 1") == "mud was -0.5: repeat it to turn it"
    assert rover.obey("word mud 1") == "applied"
    assert rover.obey("set AT_W_OLD_WATER 1") == "OLD_WATER was -1: repeat it to turn it"
    assert rover.obey("set AT_W_OLD_WATER -2") == "AT_W_OLD_WATER = -2.0"
    assert rover.obey("set AT_THR_ROI 0.4") == "AT_THR_ROI = 0.4"
    assert sent == [
        (1, {"old water": -0.5}),
        (0, {"mud": 1.0}),
        ("AT_W_OLD_WATER", -2.0),
        ("AT_THR_ROI", 0.4),
    ]


def test_the_client_knows_all_numbers_and_imports_nothing_of_ours(client: ModuleType) -> None:
    assert list(client.STATES) == [state.name.lower() for state in State]
    assert len(client.RESULTS) == len(Result)
    assert not re.search(
        r"import (companion|gcs_plugin)|from (companion|gcs_plugin)", Path(client.__file__ or "").read_text()
    )
