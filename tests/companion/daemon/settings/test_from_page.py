"""The page asks for changes of the file: shown first, written by the helper, and refused by every layer."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.config import Config, load_config
from companion.config.request import LEAVE, REQUEST
from companion.config.root_helper import answered, leave
from companion.daemon.settings.file_change import WITHIN, FileChange
from companion.daemon.settings.from_page import GOOD_FOR, PROPOSED_WITHIN, SettingsFromPage
from companion.daemon.settings.proposing import ProposingChild, proposed
from companion.vehicle.state import Vehicle
from tests.waiting import wait_for

FILE = """[vehicle]
file = ""
[camera]
source = "pipe:show me"
width = 64
height = 48
pixel_format = "rgb24"
[link]
url = "serial:/dev/ttyACM0:57600"
[web]
token = "0123456789abcdef-TOKEN"
# How often.
[call]
votes = 2
"""
STANDS = Vehicle(1, 3, 0, armed=False, heard_at=0.0)


class Desk:
    """`SettingsFromPage` with a file, and the helper, which answers when it is told to. Time is virtual."""

    def __init__(self, folder: Path, **options: Any) -> None:
        self.file, self.run, self.answers = folder / "companion.toml", folder / "run", folder / "answers"
        self.run.mkdir()
        self.answers.mkdir()
        self.file.write_text(FILE)
        self.file.chmod(0o600)
        self.vehicle: Vehicle | None = STANDS
        self.now = 0.5
        self.told = list[Mapping[str, Any]]()
        given = {"change": FileChange(self.run, self.answers), **options}
        self.settings = SettingsFromPage(load_config(self.file), self.file, **given)
        self.settings.tell = self.told.append

    def close(self) -> None:
        self.settings.close()

    def ask(self, **content: Any) -> None:
        self.settings.ask({"id": "a1", "asked_from": "10.0.0.7", **content})

    def answer(self, **content: Any) -> Mapping[str, Any]:
        """Ask, and return what is told."""
        self.told.clear()
        self.ask(**content)
        wait_for(lambda: self.told, 30.0, turn=self.turn)
        return self.told.pop()

    def turn(self) -> None:
        self.settings.poll(self.vehicle, self.now)
        time.sleep(0.005)

    def helps(self) -> None:
        leave(answered(self.file, self.run, os.getuid()), self.answers)


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Desk]:
    with closing(Desk(tmp_path)) as desk:
        yield desk


def test_what_would_change_is_shown_and_a_second_request_has_the_helper_write_it(desk: Desk) -> None:
    found = desk.answer(changes={"call.votes": 3, "camera.rate": 5.0})
    assert found["id"] == "a1"
    assert found["problem"] == ""
    assert "-votes = 2\n+votes = 3" in found["diff"]
    assert "TOKEN" not in found["diff"]
    assert desk.file.read_text() == FILE, "nothing is written for being looked at"
    desk.ask(write=found["proposal"])
    desk.turn()
    assert desk.told == []
    desk.helps()
    desk.turn()
    (told,) = desk.told
    assert (told["written"], told["restarts"]) == (True, True)
    assert "companion.toml.1" in told["text"]
    assert (desk.run / LEAVE).exists()
    desk.vehicle = replace(STANDS, armed=True)
    desk.turn()
    assert not (desk.run / LEAVE).exists(), "it is armed before the companion starts again"
    assert "votes = 3" in desk.file.read_text()
    assert "# How often." in desk.file.read_text()


def test_a_vehicle_that_is_armed_or_not_heard_stays_as_it_is(desk: Desk) -> None:
    name = desk.answer(changes={"call.votes": 3})["proposal"]
    for vehicle, why in ((replace(STANDS, armed=True), "disarm"), (None, "not known whether")):
        desk.vehicle = vehicle
        assert why in desk.answer(write=name)["problem"]
    assert not list(desk.run.iterdir())
    desk.vehicle = STANDS
    desk.ask(write=name)
    desk.turn()
    assert (desk.run / REQUEST).exists(), "once it stands, the same proposal counts"


def test_a_vehicle_that_is_armed_while_the_file_is_written_keeps_its_companion(desk: Desk) -> None:
    desk.ask(write=desk.answer(changes={"call.votes": 3})["proposal"])
    desk.turn()
    desk.helps()
    desk.vehicle = replace(STANDS, armed=True)
    desk.turn()
    (told,) = desk.told
    assert (told["problem"], told["written"], told["restarts"]) == ("", True, False)
    assert told["text"].endswith("; the vehicle is armed")
    assert not list(desk.run.iterdir())


def test_only_the_newest_proposal_is_written_and_not_for_ever(desk: Desk) -> None:
    first = desk.answer(changes={"call.votes": 3})["proposal"]
    second = desk.answer(changes={"camera.rate": 5.0})["proposal"]
    for name in (first, "", "f" * 16):
        assert desk.answer(write=name, changes={})["problem"], name
    assert "look again" in desk.answer(write=second, changes={"call.votes": 1})["problem"]
    desk.now += GOOD_FOR
    assert "look again" in desk.answer(write=second)["problem"]
    assert not list(desk.run.iterdir())


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"web.token": "0123456789abcdef-OTHER"}, "only in the shell"),
        ({"call.policy": "hold"}, "only in the shell"),
        ({"call.votes": 3, "camera.source": "pipe:rm -r /"}, "only in the shell"),
        ({"camera.source": "v4l2:0"}, "only in the shell, by `companion config set`: camera.source"),
        ({"camera.nonsense": 1}, "is not known"),
        ({"x" * 5000: 1}, "is no setting"),
        ({}, "0 settings"),
        ({f"words.w{n}": 0.5 for n in range(65)}, "65 settings"),
        ({"call.votes": 2}, "nothing would change"),
        ({"words.grass": "\ud800"}, "no value"),
        ({"vocabulary": ["\ud800"]}, "no value"),
        ({"call.votes": 1 << 70}, "would be refused"),
    ],
)
def test_what_is_guarded_unknown_or_nothing_is_refused(
    desk: Desk, changes: dict[str, object], why: str
) -> None:
    assert why in desk.answer(changes=changes)["problem"]


def test_what_the_check_would_refuse_is_told_with_its_line(desk: Desk) -> None:
    found = desk.answer(changes={"call.votes": 9, "camera.rate": "fast"})
    assert found["problem"]
    assert any("companion.toml:15: call.votes" in one for one in found["problems"])
    assert any("camera.rate" in one for one in found["problems"])
    assert "proposal" not in found


def test_without_the_helper_nothing_is_looked_at_and_that_is_said(tmp_path: Path) -> None:
    with closing(Desk(tmp_path, change=None)) as desk:
        assert "not started by its service" in desk.settings.document()["problem"]
        assert "not started by its service" in desk.answer(changes={"call.votes": 3})["problem"]


def test_where_the_helper_does_not_answer_that_is_said(desk: Desk) -> None:
    name = desk.answer(changes={"call.votes": 3})["proposal"]
    desk.ask(write=name)
    desk.turn()
    desk.now += WITHIN
    desk.turn()
    assert "systemctl status anytraverse-config.path" in desk.told[0]["problem"]
    assert not list(desk.run.iterdir())


@pytest.mark.parametrize(
    ("changes", "newer"),
    [
        ({"words": {"grass": 0.4}}, "[words]\ngrass = 0.5\nmud = -1.0\n"),
        ({"vocabulary": ["sand"]}, "[words]\nmud = -1.0\n"),
        ({"aliases": {"mud": "MD"}}, '[words]\ngrass = 1.0\n[aliases]\ngrass = "GR"\n'),
    ],
)
def test_a_table_is_not_written_over_one_that_is_newer_in_the_file(
    desk: Desk, changes: dict[str, object], newer: str
) -> None:
    desk.file.write_text(FILE + newer)
    found = desk.answer(changes=changes)
    assert "proposal" not in found
    assert found["problems"] == [
        f"{next(iter(changes))}: changed in the file since the companion was started: start it again first"
    ]
    assert "proposal" in desk.answer(changes={"call.votes": 3}), "all else is as before"


def test_a_page_that_cannot_be_told_of_a_change_does_not_end_changes_for_ever(desk: Desk) -> None:
    def fails(_: Mapping[str, Any]) -> None:
        raise OSError

    desk.ask(write=desk.answer(changes={"call.votes": 3})["proposal"])
    desk.turn()
    desk.helps()
    desk.settings.tell = fails
    desk.turn()
    desk.settings.tell = desk.told.append
    assert "another change" not in desk.answer(changes={"call.votes": 1})["problem"]


def test_one_request_at_a_time_is_taken(desk: Desk) -> None:
    desk.ask(changes={"call.votes": 3})
    desk.ask(changes={"call.votes": 1})
    assert "another change" in desk.told.pop()["problem"]
    desk.turn()
    desk.ask(changes={"call.votes": 1})
    assert "another change" in desk.told.pop()["problem"]


@pytest.mark.parametrize(
    ("program", "seconds", "why"),
    [
        ("import time; time.sleep(60)", PROPOSED_WITHIN + 0.1, "took longer"),
        ("import sys; sys.exit(3)", 0.0, "exit code 3"),
        (
            "import sys, socket; s = socket.socket(fileno=int(sys.argv[1])); s.recv(1); s.send(b'no')",
            0.0,
            "nonsense",
        ),
    ],
)
def test_a_check_that_hangs_ends_or_says_nonsense_is_told(
    tmp_path: Path, program: str, seconds: float, why: str
) -> None:
    command = (sys.executable, "-c", program)
    with closing(Desk(tmp_path, launch=lambda: ProposingChild(command))) as desk:
        desk.ask(changes={"call.votes": 3})
        desk.turn()
        desk.now += seconds
        wait_for(lambda: desk.told, 10.0, turn=desk.turn)
        assert why in desk.told[0]["problem"]
        desk.ask(changes={"call.votes": 3})
        desk.turn()
        assert len(desk.told) == 1, "the next one is taken"


def test_rows_say_what_is_in_force_without_secrets_and_what_is_for_the_shell(desk: Desk) -> None:
    document = desk.settings.document()
    rows = {row["key"]: row for row in document["rows"]}
    assert "TOKEN" not in str(document)
    assert rows["web.token"]["hidden"]
    assert (rows["call.votes"]["value"], rows["call.votes"]["shell"]) == (2, False)
    assert [rows[key]["shell"] for key in ("web.token", "camera.source", "link.url")] == [True, True, False]
    assert rows["call.votes"]["help"]


def test_a_change_too_long_to_be_shown_is_not_proposed(tmp_path: Path) -> None:
    file = tmp_path / "companion.toml"
    words = "\n".join(f"w{n} = 0.5  # {280 * 'x'}" for n in range(240))
    file.write_text(f"{FILE}[words]\n{words}\n")
    file.chmod(0o600)
    assert "too long" in proposed(file, {"words": None}).problems[0]


_VALUE = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=9)
_RUBBISH = st.dictionaries(
    st.sampled_from(["id", "asked_from", "changes", "write", "more"]) | st.text(max_size=4),
    _VALUE | st.lists(_VALUE, max_size=2) | st.dictionaries(st.text(max_size=9), _VALUE, max_size=2),
    max_size=5,
)


@given(_RUBBISH)
def test_rubbish_is_a_value_error_or_a_refusal(content: dict[str, Any]) -> None:
    told = list[Mapping[str, Any]]()
    settings = SettingsFromPage(Config(), None, None)
    settings.tell = told.append
    with suppress(ValueError):
        settings.ask(content)
        settings.poll(STANDS, 0.5)
        assert told[0]["problem"]
