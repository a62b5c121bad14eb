"""What the ground can fetch of a daemon: while it starts, while a call is open, after a restart and after."""

from __future__ import annotations

import json
import logging
import re
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from itertools import count
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from pymavlink.dialects.v20 import development as mavlink

from anytraverse.assessment import Assessment
from anytraverse.operations import SetWord
from anytraverse.picture_size import jpeg_size
from companion.desk.check.table import CHECKS, CheckReport
from companion.storage import Journal
from companion.storage.call_files import ANSWERS, MAX_CALLS, CallFiles
from companion.storage.log_file import log_to_file
from companion.storage.served_files import ServedFiles
from companion.storage.writer import Writer
from companion.vision.pictures import LIMIT, panel
from companion.wire.call_report import CallReport
from companion.wire.ids import TUNNEL_CALL, Kind, Motion
from tests.anytraverse.conftest import HEIGHT, WIDTH
from tests.companion.daemon.rig import MakeRig, Rig


def fetched(rig: Rig, path: str) -> bytes:
    opened = rig.served.tree.open(path)
    return opened.read(0, opened.size)


def told(rig: Rig, path: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(fetched(rig, path))
    return found


@contextmanager
def written(folder: Path) -> Iterator[Writer]:
    """A writer that has written all when it is left."""
    writer = Writer(Journal(folder / "journal"))
    try:
        yield writer
    finally:
        writer.close()


def names(rig: Rig, folder: str) -> dict[str, int | None]:
    return dict(rig.served.tree.entries(folder))


def place(rig: Rig) -> None:
    rig.stage.send(
        mavlink.MAVLink_global_position_int_message(0, 470000000, 80000000, 0, 0, 0, 0, 0, 9000), (1, 1)
    )
    rig.stage.send(mavlink.MAVLink_attitude_message(0, 0.1, -0.05, 1.5, 0.0, 0.0, 0.0), (1, 1))
    rig.stage.send(mavlink.MAVLink_mission_current_message(3, 8, 3, 1), (1, 1))


def test_the_state_tells_what_counts_in_two_thousand_bytes(make_rig: MakeRig) -> None:
    rig = make_rig(pictures=3)
    state = told(rig, "/state.json")
    assert (state["state"], state["policy"], state["open"]) == ("ok", "hold", None)
    assert state["latency_ms"] == 20.0
    assert state["words"] == {"grass": 1.0, "rock": -1.0}
    assert state["vocabulary"] == ["grass", "rock", "drum"]
    assert (state["settings"]["AT_THR_ROI"], state["set_by_ground"]) == (0.3, [])
    assert (state["model"], state["protocol"]) == ("painted-1", 1)
    rig.set("AT_THR_ROI", 0.4)
    rig.set("AT_W_ROCK", -0.5)
    place(rig)
    rig.see(3.0, "drum")
    rig.daemon.computer.measure()
    content = fetched(rig, "/state.json")
    assert len(content) < 2000
    state = json.loads(content)
    assert (state["settings"]["AT_THR_ROI"], state["set_by_ground"]) == (0.4, ["AT_THR_ROI"])
    assert state["words"]["rock"] == -0.5
    assert (state["open"]["id"], state["open"]["kind"], state["open"]["holding"]) == (1, "call", True)
    assert state["open"]["picture"] == "/calls/1.jpg"
    assert state["place"]["latitude"] == 47.0
    assert state["computer"]["memory_free"] > 0
    assert (state["place"]["roll"], state["place"]["heading"]) == (5.73, 90.0)


def test_the_state_tells_what_the_link_turned_away(make_rig: MakeRig) -> None:
    rig = make_rig()
    rig.see(0.5)
    rig.stage.send(mavlink.MAVLink_param_set_message(1, 191, b"AT_W_ROCK", 0.5, 9), (7, 1))
    rig.see(0.5)
    state = told(rig, "/state.json")
    assert state["link"]["rejected"] == {"sender": 1}
    assert (state["link"]["autopilot"], state["link"]["trouble"]) == ("main", None)


def test_the_calls_data_names_the_picture_that_is_served_and_it_fits_a_radio(make_rig: MakeRig) -> None:
    rig = make_rig(pictures=3)
    rig.see(3.0, "drum")
    data = CallReport.unpack(rig.stage.tunnels(TUNNEL_CALL)[-1])
    content = fetched(rig, data.picture)
    assert len(content) <= LIMIT
    drawn = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    assert drawn is not None
    call = told(rig, "/calls/1.json")
    assert call["picture"] == data.picture
    large = cv2.imdecode(np.frombuffer(fetched(rig, call["large"]), np.uint8), cv2.IMREAD_COLOR)
    assert large is not None
    assert large.shape[1] == 480
    assert jpeg_size(fetched(rig, call["raw"])) == (WIDTH, HEIGHT)
    assert names(rig, "/calls").keys() == {"1.json", "1.jpg", "1-large.jpg", "1-raw.jpg"}


@pytest.mark.slow
def test_a_blocked_hold_has_a_picture_of_what_it_was_blocked_by_until_it_is_over(make_rig: MakeRig) -> None:
    rig = make_rig(pictures=3)
    rig.see(3.0, "rock")
    data = CallReport.unpack(rig.stage.tunnels(TUNNEL_CALL)[-1])
    assert (data.kind, data.id, data.picture) == (Kind.HOLD, 1, "/calls/1.jpg")
    assert len(fetched(rig, data.picture)) <= LIMIT
    assert names(rig, "/calls").keys() == {"1.jpg", "1-large.jpg", "1-raw.jpg"}
    assert told(rig, "/state.json")["open"]["picture"] == data.picture
    rig.answer(1, Motion.GO)
    rig.see(3.0)
    assert told(rig, "/state.json")["open"] is None
    rig.see(3.0, "drum")
    call = CallReport.unpack(rig.stage.tunnels(TUNNEL_CALL)[-1])
    assert (call.kind, call.picture) == (Kind.CALL, "/calls/2.jpg")


def test_the_checks_are_served_as_they_were_found_last(make_rig: MakeRig) -> None:
    rig = make_rig()
    assert told(rig, "/check.json") == {"state": "starting"}
    report = CheckReport(rig.config)
    rig.served.show_checks(report.document)
    rig.see(3.0)
    report.refresh(rig.daemon.status.figures())
    content = fetched(rig, "/check.json")
    assert len(content) < 3200
    found = {row["check"]: (row["verdict"], row["text"]) for row in json.loads(content)["checks"]}
    assert list(found) == [check.name for check in CHECKS]
    assert found["camera"] == ("pass", "delivering, with the companion that runs")
    verdict, text = found["perceiver"]
    assert verdict == "pass"
    assert text.startswith("painted-1, 0 ms a frame; how often a foreign place matches")
    assert found["link"] == ("pass", "the companion that runs hears the autopilot on main")
    assert found["stopping"] == ("pass", "the companion that runs allows policy hold")
    assert not any("itself fails" in text for _, text in found.values())


def test_the_protocols_page_names_every_key_of_the_documents(make_rig: MakeRig) -> None:
    rig = make_rig(pictures=3)
    place(rig)
    rig.see(3.0, "drum")
    rig.answer(1, Motion.STAY)
    rig.see(0.5, "drum")
    rig.daemon.computer.measure()
    report = CheckReport(rig.config)
    report.refresh(rig.daemon.status.figures())
    state, call, checks = told(rig, "/state.json"), told(rig, "/calls/1.json"), report.document()
    inner = [
        state["open"],
        state["place"],
        state["link"],
        state["computer"],
        state["judging"],
        state["mission"],
        call["place"],
        *call["answers"],
    ]
    inner += [checks, *checks["checks"]]
    page = (Path(__file__).resolve().parents[3] / "docs" / "protocol.md").read_text()
    section = page.split("### What the documents say")[1].split("\n### ")[0]
    # test_places_known_again has the keys inside of these
    section = re.sub(r"(`(?:known_place|nearest)`:)(?:.|\n  )*", r"\1", section)
    assert set().union(state, call, *inner) == set(re.findall(r"`([a-z][a-z0-9_]*)`", section))


@pytest.mark.slow
def test_a_call_is_told_with_its_place_its_answers_and_its_end_over_a_restart(make_rig: MakeRig) -> None:
    rig = make_rig(pictures=3)
    place(rig)
    rig.see(3.0, "drum")
    call = told(rig, "/calls/1.json")
    assert (call["reasons"], call["outcome"], call["closed"]) == (["unknown_object"], None, None)
    assert (call["place"]["longitude"], call["place"]["yaw"]) == (8.0, 85.94)
    assert call["words"] == "grass: 1; rock: -1"
    left, top, right, bottom = call["worst_tile_box"]
    assert 0 < left < right < 1
    assert 0 < top < bottom < 1
    rig.answer(1, Motion.STAY)
    rig.see(0.5, "drum")
    rig.restart()
    rig.see(1.0, "drum")
    again = told(rig, "/calls/1.json")
    assert again["place"] == call["place"]
    assert [one["motion"] for one in again["answers"]] == ["stay"]
    assert again["picture"] == "/calls/1.jpg"
    rig.answer(1, Motion.GO, SetWord("drum", 1.0), transaction=8)
    rig.see(3.0, "drum")
    closed = told(rig, "/calls/1.json")
    assert [one["motion"] for one in closed["answers"]] == ["stay", "go"]
    assert [one["operations"] for one in closed["answers"]] == [[], ["drum: 1"]]
    assert closed["outcome"] == "answered"
    assert abs(closed["closed"] - call["place"]["time"]) < 60
    entry = next(one for one in rig.engine.memory.history if one.call_id == 1)
    assert (entry.place.latitude, entry.place.attitude) == (47.0, (5.73, -2.86, 85.94))


@pytest.mark.slow
@pytest.mark.parametrize("damaged", ["{", "7", b"\xff", "[" * 100_000], ids=["torn", "7", "bytes", "deep"])
def test_an_answer_that_is_damaged_in_the_journal_is_lost_and_the_call_goes_on(
    make_rig: MakeRig, damaged: object, caplog: pytest.LogCaptureFixture
) -> None:
    rig = make_rig()
    rig.see(3.0, "drum")
    for transaction in (7, 8):
        rig.answer(1, Motion.STAY, transaction=transaction)
        rig.see(0.5, "drum")
    rig.kill()
    with closing(sqlite3.connect(rig.folder / "journal.db")) as connection, connection:
        connection.execute("UPDATE answers SET record = ? WHERE number = 1", (damaged,))
    rig.start(mode=rig.stage.mode)
    rig.see(1.0, "drum")
    assert [one["transaction"] for one in told(rig, "/calls/1.json")["answers"]] == [8]
    assert "an answer to call 1 is lost: its record is damaged" in caplog.messages


@pytest.mark.slow
def test_file_picture_and_data_of_a_call_are_of_one_assessment_after_an_answer_too(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[tuple[Assessment, bytes]] = []

    def noting(seen: Assessment, *what: Any) -> bytes:
        drawn.append((seen, panel(seen, *what)))
        return drawn[-1][1]

    monkeypatch.setattr("companion.vision.pictures.panel", noting)
    rig = make_rig(pictures=3)
    rig.see(3.0, "drum")
    for words in ("grass: 1; rock: -1", "grass: 1; rock: -1; trail: 1"):
        call, data = rig.calls.call, CallReport.unpack(rig.stage.tunnels(TUNNEL_CALL)[-1])
        assert call is not None
        assert call.seen is not None
        assert call.seen.roi is not None
        (large,) = [seen for seen, content in drawn if content == fetched(rig, "/calls/1-large.jpg")]
        assert (large.words, large.roi) == (call.seen.words, call.seen.roi)
        record = told(rig, "/calls/1.json")
        assert record["words"] == call.seen.words.format() == words
        assert record["roi_uncertainty"] == call.seen.roi.uncertainty
        assert data.roi_uncertainty == pytest.approx(call.seen.roi.uncertainty, abs=1e-4)
        assert (record["frame_id"], data.frame_id) == (call.frame_id, call.seen.frame.id)
        rig.word(1, "trail", 1.0)
        rig.see(3.0, "drum")


def test_a_picture_that_cannot_be_drawn_costs_no_call(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("companion.vision.pictures.panel", lambda *_: 1 / 0)
    rig = make_rig(pictures=3)
    rig.see(3.0, "drum")
    assert rig.state == ("CALLING", 1)
    assert CallReport.unpack(rig.stage.tunnels(TUNNEL_CALL)[-1]).picture == ""


def test_without_pictures_a_call_is_told_all_the_same(held: Rig) -> None:
    assert names(held, "/calls").keys() == {"1.json"}
    assert "picture" not in told(held, "/calls/1.json")
    assert CallReport.unpack(held.stage.tunnels(TUNNEL_CALL)[-1]).picture == ""


def test_the_newest_maps_are_small_grey_pictures_of_one_frame(rig: Rig) -> None:
    rig.see(0.5, "drum")
    sizes = names(rig, "/maps")
    assert sizes.keys() == {"traversability.png", "uncertainty.png"}
    for name, size in sizes.items():
        content = fetched(rig, f"/maps/{name}")
        assert len(content) == size
        drawn = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
        assert drawn is not None
        assert drawn.ndim == 2
        assert drawn.shape[1] <= 64
        assert int(drawn.max()) == 255, "some of it is grass, and the drum is unknown"


def test_what_cannot_be_written_costs_the_file_and_no_call(make_rig: MakeRig) -> None:
    rig = make_rig(pictures=3)
    (rig.folder / "calls").rmdir()
    (rig.folder / "calls").write_text("a file in the folder's place")
    rig.see(3.0, "drum")
    assert rig.state == ("CALLING", 1)
    assert CallReport.unpack(rig.stage.tunnels(TUNNEL_CALL)[-1]).picture == ""


def test_before_it_looks_it_says_that_it_starts(tmp_path: Path) -> None:
    tree = ServedFiles(tmp_path).tree
    opened = tree.open("/state.json")
    assert json.loads(opened.read(0, 99)) == {"state": "starting"}
    assert tree.entries("/maps") == ()
    assert tree.entries("/calls") == ()
    with written(tmp_path) as writer, log_to_file(tmp_path, writer):
        logging.getLogger("companion.test").warning("it looks")
        writer.drain()
        (entry,) = tree.entries("/logs")
    content = tree.open("/logs/companion.log").read(0, 200)
    assert len(content) == entry.size
    assert content.endswith(b"WARNING companion.test: it looks\n")


def test_the_log_for_the_ground_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("companion.storage.log_file.LONGEST", 2000)
    with written(tmp_path) as writer, log_to_file(tmp_path, writer):
        for number in range(200):
            logging.getLogger("companion.test").warning("line %d", number)
    sizes = [entry.size for entry in ServedFiles(tmp_path).tree.entries("/logs")]
    assert len(sizes) == 2
    assert all(size is not None and size <= 2000 for size in sizes)
    logging.getLogger("companion.test").warning("nobody listens any more")


def test_a_log_that_cannot_be_written_stops_nothing(tmp_path: Path) -> None:
    (tmp_path / "logs").write_text("a file in the folder's place")
    with written(tmp_path) as writer, log_to_file(tmp_path, writer):
        logging.getLogger("companion.test").warning("said all the same")


def test_a_computer_without_a_clock_stamps_with_the_autopilots_time(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = make_rig()
    monkeypatch.setattr(rig.daemon.position.clock, "_wall", lambda: 1000.0)
    rig.stage.send(mavlink.MAVLink_system_time_message(1_790_000_000_000_000, 0), (1, 1))
    rig.see(3.0, "drum")
    rig.answer(1, Motion.GO, SetWord("drum", 1.0))
    rig.see(3.0, "drum")
    call = told(rig, "/calls/1.json")
    times = [call["place"]["time"], call["answers"][0]["at"], call["closed"]]
    assert all(0 < stamp - 1_790_000_000 < 10 for stamp in times)
    assert [round(record.closed or 0.0, 2) for record in rig.journal.calls()] == [call["closed"]]
    entry = next(one for one in rig.engine.memory.history if one.call_id == 1)
    assert entry.place.time is not None
    assert abs(entry.place.time - 1_790_000_000) < 10


def test_journal_and_file_tell_one_time_of_a_calls_end(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = make_rig()
    rig.see(3.0, "drum")
    monkeypatch.setattr(rig.daemon.position.clock, "_wall", count(1.79e9).__next__)
    rig.answer(1, Motion.GO, SetWord("drum", 1.0))
    rig.see(3.0, "drum")
    assert [record.closed for record in rig.journal.calls()] == [told(rig, "/calls/1.json")["closed"]]


def test_only_the_newest_calls_are_kept_whatever_the_clock_says(tmp_path: Path) -> None:
    folder = tmp_path / "calls"
    files = CallFiles(folder)
    for number in [*range(65530, 65536), *range(1, 60)]:
        files.begin_record(number, {})
    kept = sorted(int(path.stem) for path in folder.iterdir())
    assert kept == list(range(60 - MAX_CALLS, 60))


def test_of_a_call_that_was_answered_for_ever_the_newest_answers_are_told(tmp_path: Path) -> None:
    files = CallFiles(tmp_path)
    for earlier in (), [{"number": -1}] * ANSWERS:
        files.begin_record(7, {}, earlier)
        for number in range(ANSWERS + 3):
            files.add_answer(7, {"number": number})
        kept = [one["number"] for one in json.loads((tmp_path / "7.json").read_text())["answers"]]
        assert kept == list(range(3, ANSWERS + 3))


def test_what_a_kill_left_of_a_file_goes_with_its_call(tmp_path: Path) -> None:
    files = CallFiles(tmp_path)
    torn, newer = tmp_path / ".1-large.jpg.part", tmp_path / ".9.json.part"
    for path in (torn, newer):
        path.write_bytes(b"half of")
    for number in range(10, 9 + MAX_CALLS):
        files.begin_record(number, {})
    assert not torn.exists()
    assert newer.exists(), "its call is one of the newest"
