"""docs/autopilots.md names only what there is: files, links, commands, settings, parameters and texts."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from companion.cli import parser
from companion.config import load_config
from companion.desk.check import interview as checked
from companion.wire import notices, parameters, texts
from companion.wire.ids import Kind, State
from tests.companion.sim.field.stubs import AUTO, Board, driving

pytest.importorskip("lupa.lua53", reason="the script runs in Lua 5.3")

ROOT = Path(__file__).resolve().parents[4]
TEXT = (ROOT / "docs/autopilots.md").read_text(encoding="utf-8")
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
SCRIPTED = {name: value for name, value in Board().parameters.items() if name.startswith("ATS_")}


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", TEXT, re.DOTALL | re.MULTILINE)


def rows(name: str) -> dict[str, list[str]]:
    """Rows of tables that begin with a parameter of that prefix: the cells after it, the value first."""
    lines = [line for line in TEXT.splitlines() if line.startswith(f"| `{name}")]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return {row[0].split("`")[1]: row[1:] for row in cells}


def anchors(page: Path) -> set[str]:
    """As GitHub makes them of headlines."""
    heads = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_within_the_project_leads_somewhere(page: Path) -> None:
    links = re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8"))
    for link in links:
        if "://" in link:
            continue
        place, _, anchor = link.partition("#")
        target = page if not place else (page.parent / place).resolve()
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), link


def test_the_script_s_parameters_are_all_there_with_their_defaults() -> None:
    assert {name: float(cells[0]) for name, cells in rows("ATS_").items()} == SCRIPTED
    assert len(SCRIPTED) == 9


def test_no_parameter_of_ours_is_named_that_there_is_not() -> None:
    assert set(re.findall(r"\bATS_[A-Z]+", TEXT)) <= set(SCRIPTED)
    assert set(re.findall(r"\bAT_[A-Z]+", TEXT)) == {parameters.POLICY}


def test_what_the_check_asks_the_autopilot_is_explained_for_one_port_at_least() -> None:
    explained = {re.sub(r"\d+", "n", name) for name in re.findall(r"`([A-Z0-9_]+)`", TEXT)}
    for autopilot in (checked.ARDUPILOT, checked.PX4):
        asked = {re.sub(r"\d+", "n", name) for name in checked.names(autopilot)}
        assert asked - {"RO_MAX_THR_SPEED"} <= explained


def test_what_is_told_to_be_set_passes_the_check() -> None:
    first = {name: re.match(r"\d+(\.\d+)?", cells[0]) for name, cells in rows("").items()}
    told = {name: float(found[0]) for name, found in first.items() if found is not None} | SCRIPTED
    for autopilot, least in ((checked.ARDUPILOT, 7), (checked.PX4, 6)):
        values = {name: value for name, value in told.items() if name in checked.names(autopilot)}
        assert len(values) >= least
        for offboard in (False, True):
            guarded = checked.Facts(values, offboard=offboard, deadman=True)
            assert checked.judge(autopilot, guarded, holds=True) == []
            # Without the stream of sticks the transmitter must count.
            plain = {name: value for name, value in values.items() if name != "COM_RC_IN_MODE"}
            assert checked.judge(autopilot, checked.Facts(plain, offboard=offboard), holds=True) == []


def test_every_setting_in_it_is_one(tmp_path: Path) -> None:
    assert len(blocks("toml")) == 3
    for block in blocks("toml"):
        path = tmp_path / "companion.toml"
        path.write_text(f'[vehicle]\nfile = ""\n{block}', encoding="utf-8")
        load_config(str(path))


def test_every_command_of_ours_is_understood() -> None:
    commands = re.findall(r"`companion ((?:run|check|init|config|demo)[^`]*)`", TEXT)
    assert len(commands) >= 6
    for command in commands:
        words = [*command.split(), *(["udpin:0.0.0.0:14551"] if command.endswith("--link") else [])]
        parser().parse_args(words)


def test_every_file_of_ours_that_it_names_is_there() -> None:
    for name in re.findall(r"`(config/[\w./]+)`", TEXT):
        assert (ROOT / name).is_file(), name


def test_what_the_autopilot_is_quoted_to_say_is_what_the_script_says() -> None:
    board = driving()
    board.pass_time(3.0)
    board.human_sets(AUTO)
    board.pass_time(1.0)
    board.pass_time(1.0, state=State.OK)
    faulty = driving()
    faulty.pass_time(1.0, state=State.FAULT)
    said = {*board.texts(), *faulty.texts()}
    assert len(said) == 5
    for text in said:
        assert f'"{text}' in TEXT, text


def test_what_the_companion_is_quoted_to_say_is_what_it_says() -> None:
    quoted = (notices.off("RC7"), texts.holding(Kind.CALL, 3))
    for text in quoted:
        assert f'"{text}"' in TEXT
