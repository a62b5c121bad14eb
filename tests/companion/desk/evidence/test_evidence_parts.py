"""What each part of evidence is made of: each is a pure function of what is stored."""

from __future__ import annotations

import errno
import itertools
import json
import os
import subprocess
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import Writer

from companion.config import Config, load_config
from companion.config.schema import JournalSection
from companion.desk.check.stop_file import read_stops, write_stops
from companion.desk.check.zone_file import Zone, ZoneArc, ZoneLook, ZoneMark, write_zone
from companion.desk.evidence import versions
from companion.desk.evidence.calls import call_times, calls_part
from companion.desk.evidence.camera import camera_losses, camera_part
from companion.desk.evidence.checked import check_part, run_check
from companion.desk.evidence.collect import evidence, read_sources
from companion.desk.evidence.computer import computer_part
from companion.desk.evidence.drives import (
    AnswerSample,
    CameraSample,
    DecisionSample,
    DrivenFacts,
    read_drives,
)
from companion.desk.evidence.faults import FAULTS, faults_part
from companion.desk.evidence.link import link_part
from companion.desk.evidence.log import read_log
from companion.desk.evidence.page import page
from companion.desk.evidence.parts import MOST_ROWS, Basis, EvidencePart, quantile, utc
from companion.desk.evidence.sources import Sources
from companion.desk.evidence.stopping import stopping_part
from companion.desk.evidence.versions import versions_part
from companion.desk.evidence.zone import zone_part
from companion.observers.recording import reading, records
from companion.observers.recording.foxglove import NS
from companion.observers.recording.topics import TOPICS, Topic
from companion.storage.log_file import FOLDER as LOGS
from companion.storage.log_file import NAME as LOG
from companion.vehicle.brakes import Measured

DOCS = Path(__file__).parents[4] / "docs"
NOON = 1_790_000_000.0


def sources(folder: Path, **more: Any) -> Sources:
    config = replace(Config(), journal=JournalSection(folder=str(folder)))
    return Sources(config, folder, NOON, **more)


def figures(part: EvidencePart) -> dict[str, Any]:
    return {one["name"]: one["value"] for one in part.figures}


@given(
    st.lists(st.tuples(st.floats(3, 30), st.floats(0.3, 20)), max_size=5),
    st.floats(0, 0.99),
    st.floats(0.8, 1.2),
    st.booleans(),
)
def test_the_bounds_of_a_loss_contain_its_length(
    spans: list[tuple[float, float]], phase: float, period: float, restarted: bool
) -> None:
    """spans: seconds with ten pictures a second and without any, in turn. restarted: counts begin anew."""
    pictures, gaps, at = list[float](), list[tuple[float, float]](), 0.0
    for here, gone in spans:
        pictures += [at + number / 10 for number in range(int(here * 10))]
        begin, at = pictures[-1], at + here + gone
        gaps.append((begin, at))
    pictures += [at + number / 10 for number in range(30)]
    times = [phase + number * period for number in range(int((at + 3 - phase) / period))]
    samples = []
    for one in times:
        count = sum(picture <= one for picture in pictures)
        before = [sum(picture <= begin for picture in pictures) for begin, over in gaps if over <= one]
        samples.append(CameraSample(one, 7, count - (before[-1] if restarted and before else 0)))
    found = camera_losses(samples, 1.0)
    for loss in found:
        (gap,) = [gap for gap in gaps if gap[0] <= loss.at < gap[1]]
        assert loss.most is not None
        assert loss.least - 1e-6 <= gap[1] - gap[0] <= loss.most + 1e-6
        assert loss.most - loss.least <= 2.0 * period + 1e-6
    assert len(found) >= sum(over - begin > 1.0 + 2.0 * period and begin > times[1] for begin, over in gaps)


def test_a_loss_that_a_restart_cuts_off_has_no_end() -> None:
    samples = [
        CameraSample(float(at), pid, read, trouble=trouble)
        for at, pid, read, trouble in (
            *((1, 7, 10, False), (2, 7, 20, False), (3, 7, 20, False), (4, 7, 20, True), (5, 8, 0, False)),
            *((6, 8, 10, False), (7, 8, 10, False), (8, 8, 10, False), (60, 8, 99, False)),
        )
    ]
    assert camera_losses(samples, 1.5) == [(2.0, 2.0, None, True), (6.0, 2.0, None, False)]
    assert camera_losses(samples, 2.5) == []
    assert camera_losses([], 1.0) == []


def logged(folder: Path, *lines: tuple[float, str], name: str = LOG) -> None:
    (folder / LOGS).mkdir(parents=True, exist_ok=True)
    text = ""
    for at, line in lines:
        stamp = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(at))
        text += f"{stamp},{round(at % 1 * 1000):03d} WARNING companion.daemon.health: {line}\n"
    (folder / LOGS / name).write_text(text)


def table(part: EvidencePart, title: str) -> list[dict[str, Any]]:
    (found,) = [one["rows"] for one in part.tables if one["title"] == title]
    return list(found)


def test_the_log_alone_tells_each_fault_and_how_long_it_stood(tmp_path: Path) -> None:
    logged(tmp_path, (NOON, "ready: policy hold"), (NOON + 1, "fault: camera frozen"), name=f"{LOG}.1")
    logged(
        tmp_path,
        (NOON + 9.5, "the fault is over"),
        (NOON + 20, "fault: camera silent: no good frame for 5 s: check cable"),
        (NOON + 21, "fault: autopilot silent: check its power"),
        (NOON + 24, "the autopilot is heard again"),
        (NOON + 30, "link lost: gone"),
        (NOON + 33, "link is back"),
        (NOON + 40, "the companion was stalled for 1.2 s: check the load"),
        (NOON + 41, "fault: something new"),
        (NOON + 50, "ready: policy hold"),
    )
    part = faults_part(sources(tmp_path, logged=read_log(tmp_path)))
    kinds = {one["fault"]: one for one in table(part, "Kinds of faults")}
    assert kinds["camera frozen"]["seen"] == 1
    assert kinds["camera frozen"]["stood, at most, s"] == pytest.approx(6.5)
    assert kinds["no pictures from the camera"]["seen"] == 1
    assert kinds["no pictures from the camera"]["stood, at most, s"] is None, "it stood as it ended"
    assert kinds["autopilot silent"]["stood, at most, s"] == pytest.approx(3.0)
    assert kinds["link lost"]["stood, at most, s"] == pytest.approx(3.0)
    assert kinds["main loop stopped"]["seen"] == 1
    assert kinds["vision hangs"]["seen"] == "not in this log"
    assert f"This log begins {utc(NOON)}" in part.note
    told = figures(part)
    assert told["faults of other kinds"] == 0, "the third began while one stood"
    assert told["starts of the companion"] == 2
    assert told["ends without being told to stop: killed, crashed, or without power"] == 2


def test_an_end_that_was_ordered_does_not_hide_a_crash(tmp_path: Path) -> None:
    ended = "told to stop, and stopped"
    lines = [ended, "ready: policy hold", "ready: policy hold", ended, "ready: policy hold"]
    logged(tmp_path, *((NOON + at, line) for at, line in enumerate(lines)))
    for running, unclean in ((True, 1), (False, 2)):
        told = figures(faults_part(sources(tmp_path, logged=read_log(tmp_path), running=running)))
        assert told["ends without being told to stop: killed, crashed, or without power"] == unclean


def test_what_a_clock_lengthens_that_was_set_is_not_told(tmp_path: Path) -> None:
    logged(tmp_path, (100.0, "link lost: gone"), (NOON, "link is back"))
    rows = table(faults_part(sources(tmp_path, logged=read_log(tmp_path))), "Kinds of faults")
    (lost,) = [one for one in rows if one["fault"] == "link lost"]
    assert (lost["seen"], lost["stood, at most, s"]) == (1, None)
    driven = DrivenFacts(files=1, decisions=[DecisionSample(100.0, "call opened", 1)])
    driven.answers.append(AnswerSample(NOON, 1, "applied"))
    assert call_times(driven) == [(True, None)]


def test_a_part_of_the_log_that_cannot_be_read_is_told(tmp_path: Path) -> None:
    logged(tmp_path, (NOON, "ready: policy hold"))
    (tmp_path / LOGS / f"{LOG}.1").mkdir()
    part = faults_part(sources(tmp_path, logged=read_log(tmp_path)))
    assert "a part of the log" in [one.what for one in part.unknown]


def test_a_log_of_rubbish_tells_nothing(tmp_path: Path) -> None:
    (tmp_path / LOGS).mkdir()
    (tmp_path / LOGS / LOG).write_bytes(
        bytes(range(256)) * 50 + b"\n2026-99-99 99:99:99,999 ERROR a: fault: x\n"
    )
    read = read_log(tmp_path)
    assert read.lines == ()
    assert faults_part(sources(tmp_path, logged=read)).unknown[0].what == "which faults were seen"


def test_the_faults_are_rows_of_the_page() -> None:
    page_text = (DOCS / "faults.md").read_text()
    for kind in FAULTS:
        for name in kind.rows:
            assert f"| {name} |" in page_text


def decided(at: float, what: str, number: int = 0, event: str = "") -> DecisionSample:
    return DecisionSample(NOON + at, what, number, event)


def test_operators_seconds_are_those_to_the_first_answer_that_counts(tmp_path: Path) -> None:
    driven = DrivenFacts(files=3, begin=NOON, end=NOON + 100, metres=500.0)
    driven.decisions += [
        decided(0, "call opened", 7),
        decided(20, "call closed", 7),
        decided(30, "call opened", 8),
        decided(40, "call closed", 8),
    ]
    driven.answers += [
        AnswerSample(NOON + 2, 7, "refused"),
        AnswerSample(NOON + 5, 7, "not_covered"),
        AnswerSample(NOON + 9, 7, "applied"),
        AnswerSample(NOON + 41, 8, "applied"),
    ]
    assert [one.first for one in call_times(driven)] == [5.0, None]
    told = figures(calls_part(sources(tmp_path, driven=driven)))
    assert told["calls per km"] == 4.0
    assert told["operator's seconds per km, of answered calls"] == 10.0
    assert told["calls answered"] == 1
    part = calls_part(sources(tmp_path, driven=replace(driven, lacking=2)))
    assert not [name for name in figures(part) if "per km" in name], "those without a call were deleted first"
    assert "calls per kilometre" in [one.what for one in part.unknown]


def test_a_takeover_and_a_mode_of_ours_after_it_are_told(tmp_path: Path) -> None:
    driven = DrivenFacts(files=1, begin=NOON, end=NOON + 100)
    driven.decisions += [
        decided(0, "set mode", 7),
        decided(0, "hold started", 7),
        decided(0.4, "hold moved", 7, event="confirmed"),
        decided(5, "hold moved", 7, event="taken_over"),
        decided(6, "set mode", 8),
        decided(30, "hold moved", 8, event="taken_over"),
    ]
    told = figures(calls_part(sources(tmp_path, driven=driven)))
    assert told["holds that a human's mode ended"] == 2
    assert told["of these, a mode of ours within 2 s"] == 1
    assert told["from order to hold until the autopilot shows it, longest"] == pytest.approx(0.4)


def recorded(folder: Path, number: int, messages: Sequence[tuple[Topic, float, Mapping[str, Any]]]) -> Path:
    (folder / "recordings").mkdir(exist_ok=True)
    path = folder / "recordings" / f"{number:06d}.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channels = dict[Topic, int]()
        for topic, at, told in messages:
            if topic not in channels:
                channels[topic] = writer.register_channel(TOPICS[topic].name, "json", 0)
            writer.add_message(channels[topic], int(at * NS), json.dumps(told).encode(), int(at * NS))
        writer.finish()
    return path


def heard(at: float) -> tuple[Topic, float, Mapping[str, Any]]:
    told = {"heard_at": at, "system_id": 1, "autopilot": 3, "type": 10}
    return Topic.VEHICLE, NOON + at, told


def test_heartbeats_that_did_not_come_are_told_but_not_the_time_between_recordings(tmp_path: Path) -> None:
    recorded(tmp_path, 1, [heard(10.0), heard(11.0), heard(15.0)])
    recorded(tmp_path, 2, [heard(900.0), heard(901.0)])
    told = link_part(sources(tmp_path, driven=read_drives(tmp_path)))
    name = "between two heartbeats of the autopilot, in one recording, longest"
    (longest,) = [one for one in told.figures if one["name"] == name]
    assert (longest["value"], longest["samples"]) == (4.0, 3)
    assert figures(told)["autopilot"] == "system 1, ArduPilot"
    other = link_part(sources(tmp_path, driven=DrivenFacts(files=1, vehicles={(2, 99, 1)})))
    assert figures(other)["autopilot"] == "system 2, MAV_AUTOPILOT 99, MAV_TYPE 1"


def test_reading_ends_after_so_many_messages_and_keeps_what_it_has(tmp_path: Path) -> None:
    for number in (1, 2, 3):
        recorded(tmp_path, number, [heard(float(each)) for each in range(10)])
    found = read_drives(tmp_path, most=15)
    assert (found.files, found.unread, len(found.gaps)) == (2, 1, 9 + 4)


def test_the_time_is_kept_within_a_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorded(tmp_path, 1, [heard(float(each)) for each in range(100)])
    now = itertools.count()
    monkeypatch.setattr("time.monotonic", lambda: float(next(now)))
    assert 0 < len(read_drives(tmp_path, longest=30.0).gaps) < 40


@pytest.mark.parametrize("set_by", [-7200.0, 3600.0])
def test_a_clock_that_is_set_while_it_records_makes_the_recorded_time_no_longer(
    tmp_path: Path, set_by: float
) -> None:
    recorded(tmp_path, 1, [heard(each + (set_by if each >= 10 else 0.0)) for each in range(20)])
    assert read_drives(tmp_path).seconds == pytest.approx(18.0)


def test_recordings_that_were_deleted_in_between_are_counted(tmp_path: Path) -> None:
    for number in (3, 4, 7):
        recorded(tmp_path, number, [heard(1.0)])
    assert read_drives(tmp_path).lacking == 2


def test_a_bad_sector_costs_one_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bad, _ = (recorded(tmp_path, number, [heard(1.0)]) for number in (1, 2))
    opened = records.opened

    def failing(path: Path) -> Any:
        if path == bad:
            raise OSError(errno.EIO, "Input/output error", str(path))
        return opened(path)

    monkeypatch.setattr(reading, "opened", failing)
    found = read_drives(tmp_path)
    assert (found.files, found.damaged, found.unread) == (1, 1, 0)
    told = evidence(sources(tmp_path, driven=found), "SHA256:x")
    assert "1 damaged recordings" in [one["what"] for one in told["unknown"]]


def test_stops_are_stored_read_and_fitted(tmp_path: Path) -> None:
    path = write_stops(tmp_path, [("HOLD", [Measured(0.5, 1.0), Measured(1.5, 3.9)]), ("GUIDED", [])], NOON)
    (path.parent / "20260101T000000Z.json").write_text("{}")
    (path.parent / "20260102T000000Z.json").write_text("rubbish")
    found, unread = read_stops(tmp_path)
    assert [(one.at, one.mode, len(one.stops)) for one in found] == [(NOON, "HOLD", 2)]
    assert [name for name, _ in unread] == ["20260101T000000Z.json", "20260102T000000Z.json"]
    part = stopping_part(sources(tmp_path))
    told = figures(part)
    assert told["slowest stop measured by HOLD"] == 0.5
    assert told["time constant fitted, HOLD"] > 0.0
    assert len(part.unknown) == 2
    assert table(part, f"Stops by HOLD, {utc(NOON)}")[1] == {"speed, m/s": 1.5, "way to standstill, m": 3.9}


@given(st.binary(max_size=200))
def test_a_file_of_stops_may_hold_anything(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    folder = tmp_path_factory.mktemp("stops")
    (folder / "stops").mkdir()
    (folder / "stops" / "20260101T000000Z.json").write_bytes(content)
    found, unread = read_stops(folder)
    assert len(unread) + len(found) <= 1


def test_a_measured_zone_is_told_with_its_marks(tmp_path: Path) -> None:
    look: dict[str, Any] = {"frames": 10, "reasons": (), "at": "20261127T234500Z"}
    mark = {**look, "line": "middle", "bearing_deg": 0.0, "elsewhere": False}
    marks = (
        ZoneMark(**mark, noticed_frames=10, distance_m=1.0, noticed=True, in_picture=True),
        ZoneMark(**mark, noticed_frames=1, distance_m=2.0, noticed=False, in_picture=False),
    )
    zone = Zone(
        at="20261127T234500Z",
        program="0.1.0",
        identity="abc",
        model="builtin",
        words={"grass": 1.0},
        thresholds={"roi": 0.3},
        region={"near": 0.3},
        mount={"height": 0.5},
        stop={"speed": 1.0, "needs": 1.5},
        thing="a crate <b>",
        distances=(1.0, 2.0, 3.0),
        verdict="",
        marks=marks,
        arcs=(ZoneArc(**look, noticed_frames=5, distance_m=1, from_deg=-30, to_deg=30),),
        empty=ZoneLook(**look, noticed_frames=2),
    )
    write_zone(tmp_path, zone)
    (tmp_path / "zone" / "20261128T000000Z.json").write_text("rubbish")
    part = zone_part(sources(tmp_path))
    told = figures(part)
    assert told["20261127T234500Z: marks measured"] == 2
    assert told["20261127T234500Z: farthest mark at which it was noticed"] == 1.0
    assert told["20261127T234500Z: frames with nothing there in which something was noticed"] == 20.0
    assert [one["noticed"] for one in table(part, "Marks of 20261127T234500Z")] == [True, False]
    assert [one.what for one in part.unknown] == [
        "a measured zone",
        "whether the zone covers the stop",
        "1 marks of the newest zone",
    ]


def test_with_no_time_left_all_recordings_are_unread_and_that_is_told(driven: Path) -> None:
    found = read_drives(driven.parent / "state", longest=-1.0)
    assert (found.files, found.unread) == (0, 1)
    told = evidence(sources(driven.parent / "state", driven=found), "SHA256:x")
    assert "1 older recordings" in [one["what"] for one in told["unknown"]]


def test_damaged_recordings_are_no_error(driven: Path, tmp_path: Path) -> None:
    (tmp_path / "recordings").mkdir()
    (whole,) = (driven.parent / "state" / "recordings").glob("*.mcap")
    content = whole.read_bytes()
    (tmp_path / "recordings" / "000001.mcap").write_bytes(content[:-200])
    (tmp_path / "recordings" / "000002.mcap").write_bytes(content[: len(content) // 2])
    (tmp_path / "recordings" / "000003.mcap").write_bytes(b"rubbish")
    found = read_drives(tmp_path)
    assert (found.files, found.unread) == (3, 0)
    assert len(found.ages) > 0


@pytest.mark.slow
@given(st.dictionaries(st.sampled_from(["camera", "link", "perceiver", "pid", "computer"]), st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)))  # fmt: skip
def test_a_status_may_hold_anything(tmp_path_factory: pytest.TempPathFactory, said: dict[str, Any]) -> None:
    folder = tmp_path_factory.mktemp("status")
    told = evidence(sources(folder, written=NOON, status=said, no_journal="x"), "SHA256:x")
    json.dumps(told, allow_nan=False)
    assert page(told, "")


def test_all_that_is_shown_is_text(tmp_path: Path) -> None:
    evil = "<script>alert(1)</script>"
    part = EvidencePart(evil)
    part.tell(Basis(evil), (evil, evil, evil))
    part.tabulate(evil, [{evil: evil}])
    part.lack(evil, evil, evil)
    part.note = evil
    told = evidence(sources(tmp_path), "SHA256:<x>")
    unknown = [one._asdict() for one in part.unknown]
    shown = page({**told, "parts": {"x": part.document()}, "unknown": unknown}, evil)
    assert "<script" not in shown
    assert shown.count("&lt;script&gt;") == 15


def test_a_long_table_has_its_last_rows_and_counts_the_others() -> None:
    part = EvidencePart("x")
    part.tabulate("t", [{"n": number} for number in range(MOST_ROWS + 5)])
    (made,) = part.tables
    assert (len(made["rows"]), made["left_out"], made["rows"][-1]) == (MOST_ROWS, 5, {"n": MOST_ROWS + 4})


@pytest.mark.skipif(os.geteuid() != 0, reason="only root reads a checkout of somebody else")
def test_the_commit_of_another_users_checkout_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for path in (tmp_path, *tmp_path.parents[:2]):
        path.chmod(0o755)
    made = ("-c", "user.name=x", "-c", "user.email=x", "commit", "-q", "--allow-empty", "-m", "x")
    for words in (("init", "-q"), made):
        subprocess.run(["git", *words], cwd=tmp_path, check=True)
    for path in (tmp_path, *tmp_path.rglob("*")):
        os.chown(path, 65534, 65534)
    monkeypatch.setattr(versions, "_ROOT", tmp_path)
    assert figures(versions_part(sources(tmp_path)))["commit"]


@given(st.lists(st.floats(0, 100), min_size=1), st.floats(0.01, 1))
def test_a_share_of_all_values_is_no_greater(values: list[float], least: float) -> None:
    found = quantile(values, least)
    assert sum(value <= found for value in values) >= least * len(values) - 1e-9


@given(st.floats(allow_nan=True))
def test_any_time_is_formatted_or_none(at: float) -> None:
    told = utc(at)
    assert told is None or told.endswith("Z")


def test_each_part_is_made_of_nothing(tmp_path: Path) -> None:
    for part in (
        *(computer_part, camera_part, stopping_part, zone_part, faults_part),
        *(link_part, calls_part, versions_part, check_part),
    ):
        made = part(sources(tmp_path, no_journal="there is none", no_check="not now"))
        assert made.title
        assert made.unknown or part in (computer_part, versions_part)


def test_root_in_anybodys_folder_runs_nothing_of_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "companion").mkdir()
    (tmp_path / "companion" / "__init__.py").write_text("")
    (tmp_path / "companion" / "__main__.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')")
    monkeypatch.chdir(tmp_path)
    rows, _ = run_check("nothere.toml", 60.0)
    assert not (tmp_path / "ran").exists(), rows


def test_a_check_that_does_not_end_is_ended(tmp_path: Path) -> None:
    began = time.monotonic()
    assert run_check(str(tmp_path / "companion.toml"), 0.01) == (
        [],
        "companion check did not end within 0.01 s",
    )
    assert time.monotonic() - began < 5.0


@pytest.mark.slow
def test_what_companion_check_says_now_is_in_it(driven: Path) -> None:
    found = read_sources(load_config(str(driven)), str(driven))
    rows = {one["check"]: one["verdict"] for one in found.checked}
    assert rows["config"] == "pass", found.no_check
    assert rows["camera"] == "fail"
    assert table(check_part(found), "What companion check says now")
