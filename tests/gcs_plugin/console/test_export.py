"""Calls packed into a zip: what is in it, that hostile text stays text, and that it is bounded."""

from __future__ import annotations

import base64
import io
import json
import zipfile
from html.parser import HTMLParser
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from gcs_plugin.console.export import MOST_BYTES, MOST_CALLS, ExportedCall, pack

WALL = 1_790_000_000.0
JPEG = bytes.fromhex("ffd8ffe000104a46494600010100000100010000ffc0001108006000800301220002110103110100")
HOSTILE = "\"'></p><script>alert(1)</script><img src=http://evil.example/ onerror=alert(1)>"
VOID = {"meta", "img", "rect"}
TAGS = VOID | {
    "html", "head", "title", "style", "body", "h1", "h2", "p", "section", "div", "figure", "figcaption",
    "svg", "ol", "li", "time",
}  # fmt: skip


class Read(HTMLParser):
    """Reads the page: its elements, addresses and text."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str]] = []
        self.text = ""
        self.open: list[str] = []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [(name, value or "") for name, value in attrs]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def shown(number: int = 7, **more: Any) -> dict[str, Any]:
    return {
        "id": number,
        "name": f"C{number}",
        "kind": "call",
        "opened": WALL - 60,
        "closed": WALL - 30,
        "open": False,
        "outcome": "answered",
        "reasons": ["unknown_object"],
        "reason": "Something in the middle that none of its words explains.",
        "figures": "38% of the region of interest unexplained",
        "box": [0.41, 0.55, 0.6, 0.81],
        "place": [47.0, 8.0, 90.0],
        "pictures": {"small": "/pictures/1/7/small.jpg?v=1.1"},
        "answers": [{"at": WALL - 40, "said": "drum: -1, go", "text": "done", "tone": "good"}],
        "said": [{"at": WALL - 30, "text": "The rover drives on (AUTO)."}],
        "undone": None,
    } | more


def unpacked(content: bytes) -> tuple[dict[str, bytes], Read]:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        assert archive.testzip() is None
        files = {name: archive.read(name) for name in archive.namelist()}
    page = Read(files["report.html"].decode())
    assert page.open == []
    assert set(page.tags) <= TAGS
    assert [name for name, _ in page.attributes if name.startswith("on") or name == "href"] == []
    for name, value in page.attributes:
        assert name != "src" or value.startswith("data:image/jpeg;base64,")
    return files, page


def test_one_call_has_its_pictures_data_answer_and_a_page_without_a_script() -> None:
    files, page = unpacked(pack(3, [ExportedCall(shown(), {"small": JPEG, "large": JPEG + b"large"})], WALL))
    assert set(files) == {"report.html", "call-7/data.json", "call-7/small.jpg", "call-7/large.jpg"}
    assert files["call-7/large.jpg"] == JPEG + b"large"
    told = json.loads(files["call-7/data.json"])
    assert (told["rover"], told["id"], told["answers"][0]["said"]) == (3, 7, "drum: -1, go")
    assert "pictures" not in told
    inside = [base64.b64decode(value.partition(",")[2]) for name, value in page.attributes if name == "src"]
    assert inside == [JPEG, JPEG + b"large"]
    assert "Operator: drum: -1, go. done" in page.text
    assert page.text.index("drum: -1, go") < page.text.index("Rover: The rover drives on (AUTO).")
    assert ("x", "41") in page.attributes
    assert b"default-src 'none'" in files["report.html"]


def test_several_calls_are_one_report() -> None:
    files, page = unpacked(pack(1, [ExportedCall(shown(n), {"small": JPEG}) for n in (9, 7)], WALL))
    assert page.tags.count("section") == 2
    assert page.text.index("Call C9: answered") < page.text.index("Call C7: answered")
    assert {"call-9/data.json", "call-7/data.json"} < set(files)


def test_a_call_without_a_picture_or_an_answer_says_so() -> None:
    plain = shown(answers=[], said=[], box=None, place=None, opened=0.0, closed=None)
    files, page = unpacked(pack(1, [ExportedCall(plain, {"small": b"no picture"})], WALL))
    assert set(files) == {"report.html", "call-7/data.json"}
    assert "Its picture had not come to the console." in page.text
    assert "It was not answered from this console." in page.text
    assert "Opened at a time not known" in page.text


@given(st.text(max_size=80) | st.sampled_from([HOSTILE, "\ud800", "\0]]>-->"]))
def test_text_that_came_by_radio_stays_text(text: str) -> None:
    hostile = shown(
        name=text,
        outcome=text,
        reason=text,
        figures=text,
        first=text,
        undone=text,
        given=[text],
        answers=[{"at": WALL, "said": text, "text": text, "tone": "bad"}],
        said=[{"at": WALL, "text": text}],
    )
    files, page = unpacked(pack(1, [ExportedCall(hostile, {"small": JPEG})], WALL))
    assert set(files) == {"report.html", "call-7/data.json", "call-7/small.jpg"}
    assert json.loads(files["call-7/data.json"])["reason"] == text
    if text == HOSTILE:
        assert page.text.count(HOSTILE) >= 8
        assert page.tags.count("img") == 1


def test_the_zip_is_bounded_and_says_what_it_left_out() -> None:
    big = JPEG + bytes(MOST_BYTES - len(JPEG) - 100)
    calls = [ExportedCall(shown(n), {"small": JPEG, "large": big}) for n in range(1, MOST_CALLS + 9)]
    content = pack(1, calls, WALL)
    files, page = unpacked(content)
    assert len(content) < 3 * MOST_BYTES
    assert page.tags.count("section") == MOST_CALLS
    assert sum(len(one) for name, one in files.items() if name.endswith(".jpg")) <= MOST_BYTES
    assert page.text.count("How it judged that: left out, the report would be too large.") == MOST_CALLS - 1


@given(st.floats(allow_nan=False) | st.integers())
def test_any_time_that_a_rover_claims_can_be_written(at: float) -> None:
    said = [{"at": at, "text": "C7 done"}]
    unpacked(pack(1, [ExportedCall(shown(opened=at, closed=at, said=said), {})], 0.0))
