"""docs/protocol.md against the code: its tables, and the client written from it."""

import importlib.util
import re
import time
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from anytraverse.operations import SetWord
from companion.wire.answers import Answer
from companion.wire.examples import BOX, EXAMPLES
from companion.wire.ids import (
    TUNNEL_ACKNOWLEDGEMENT,
    TUNNEL_CALL,
    TUNNEL_SUMMARY,
    Motion,
    Result,
    State,
    words_hash,
)
from companion.wire.tables import TABLES, filled

DOCS = Path(__file__).resolve().parents[3] / "docs"
PAGE = (DOCS / "protocol.md").read_text()


def test_the_page_has_its_tables_as_the_code_writes_them() -> None:
    assert filled(PAGE) == PAGE, "python -m companion.wire.tables writes them"
    assert set(re.findall(r"<!-- table: (.+) -->", PAGE)) == TABLES.keys()


def test_a_table_that_differs_is_written_anew() -> None:
    assert filled("a\n<!-- table: numbers -->\nold\n<!-- end -->\nb") == (
        f"a\n<!-- table: numbers -->\n{TABLES['numbers']()}<!-- end -->\nb"
    )
    with pytest.raises(KeyError, match="weather"):
        filled("<!-- table: weather -->\n<!-- end -->")


@pytest.mark.parametrize("kind", EXAMPLES)
def test_an_example_is_read_back_as_it_was(kind: str) -> None:
    made = type(EXAMPLES[kind]).unpack(EXAMPLES[kind].pack())
    assert made == ((EXAMPLES[kind], 0, 1) if isinstance(made, tuple) else EXAMPLES[kind])


def test_the_page_tells_how_words_are_summed_up() -> None:
    assert f"`bush:-5000;grass:10000`,\n{words_hash({'grass': 1.0, 'bush': -0.5}):X}" in PAGE


def test_every_link_inside_the_page_leads_to_a_heading() -> None:
    headings = re.findall(r"^##+ (.+)$", PAGE, re.MULTILINE)
    anchors = {re.sub(r"[^a-z0-9 -]", "", title.lower()).replace(" ", "-") for title in headings}
    assert set(re.findall(r"\]\(#([^)]+)\)", PAGE)) <= anchors


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
