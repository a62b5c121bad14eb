"""The rows about the link: what was heard when the autopilot was asked, and what a running companion says."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest

from companion.config import load_config
from companion.desk.check.autopilot import CHECK, LINK, AutopilotReadings
from companion.desk.check.link import check_autopilot, check_forwarding, check_link, check_signing
from companion.desk.check.rover import CheckedRover
from companion.desk.check.rules import CheckFinding, failed, passed, warned
from companion.wire.signing import DAY, SignedStream, ticks
from companion.wire.signing_store import TimestampFile

URL = "udpin:0.0.0.0:14550"


def rover(
    folder: Path, asked: AutopilotReadings | None = None, running: dict[str, Any] | None = None, key: str = ""
) -> CheckedRover:
    path = folder / "companion.toml"
    signing = f'[link]\nsigning_key = "{key}"\n' if key else ""
    path.write_text(f'[web]\nlisten = ""\n[vehicle]\nfile = ""\n{signing}')
    one = CheckedRover(load_config(str(path)), str(path), folder, running)
    if asked is not None:
        one.__dict__["asked"] = asked  # as if it had been asked
    return one


def only(findings: list[CheckFinding]) -> tuple[str, str]:
    (finding,) = findings
    return finding.verdict.name.lower(), finding.text


HEARD = AutopilotReadings(
    [warned(LINK, "not here: other"), passed(CHECK, "well"), warned("FS_ACTION 0", "set 2")], url=URL
)
SILENT = AutopilotReadings([failed(LINK, "nothing heard")], heard=False)


def test_an_autopilot_that_is_heard_is_told_with_its_connection_and_then_its_parameters(
    tmp_path: Path,
) -> None:
    one = rover(tmp_path, HEARD)
    assert [finding.text for finding in check_link(one)] == [
        "not here: other",
        f"{URL}: an autopilot is heard",
    ]
    assert [finding.check for finding in check_autopilot(one)] == [CHECK, "FS_ACTION 0"]


def test_where_none_is_heard_the_link_fails_and_what_depends_on_it_is_skipped(tmp_path: Path) -> None:
    one = rover(tmp_path, SILENT)
    assert only(check_link(one)) == ("fail", "nothing heard")
    assert only(check_autopilot(one))[0] == only(check_forwarding(one))[0] == "skip"


@pytest.mark.parametrize(
    ("grounds", "verdict", "told"),
    [
        (((255, 190),), "pass", "ground station 255/190 is heard here"),
        (((7, 190),), "warn", "7/190 is heard here, and may not answer: add it to [link] allowed_senders"),
        (((7, 190), (255, 190)), "pass", "7/190, 255/190"),
        ((), "warn", "connect one, and let autopilot or router forward"),
    ],
)
def test_ground_stations_are_told_and_whether_they_may_answer(
    tmp_path: Path, grounds: tuple[tuple[int, int], ...], verdict: str, told: str
) -> None:
    found = only(check_forwarding(rover(tmp_path, AutopilotReadings([], url=URL, grounds=grounds))))
    assert (found[0], told in found[1]) == (verdict, True), found


@pytest.mark.parametrize(
    ("said", "verdict", "told"),
    [
        ({"trouble": "serial: gone", "autopilot": "main"}, "fail", "serial: gone"),
        ({"trouble": None, "autopilot": None}, "warn", "hears no autopilot"),
        ({"trouble": None, "autopilot": "wifi"}, "pass", "the autopilot on wifi"),
        ({}, "warn", "hears no autopilot"),
    ],
)
def test_a_companion_that_runs_owns_the_link_and_says_how_it_is(
    tmp_path: Path, said: dict[str, Any], verdict: str, told: str
) -> None:
    one = rover(tmp_path, running={"link": said})
    found = only(check_link(one))
    assert (found[0], told in found[1]) == (verdict, True), found
    assert only(check_autopilot(one))[0] == "skip"


def test_a_test_call_that_was_answered_shows_the_way_to_the_ground(tmp_path: Path) -> None:
    one = rover(tmp_path, running={"test_call": {"state": "answered", "text": "C4 TEST answered by 255/190"}})
    assert only(check_forwarding(one)) == ("pass", "C4 TEST answered by 255/190")
    one = rover(tmp_path, running={"test_call": {"state": "unanswered"}})
    assert "`companion check --dry-run`" in only(check_forwarding(one))[1]


def test_the_signing_key_is_read(tmp_path: Path) -> None:
    assert only(check_signing(rover(tmp_path, HEARD)))[0] == "warn"
    one = rover(tmp_path, HEARD, key="key")
    assert only(check_signing(one))[0] == "fail"
    (tmp_path / "key").write_text("0" * 63)
    (tmp_path / "key").chmod(0o600)
    assert only(check_signing(one))[0] == "fail"
    (tmp_path / "key").write_text("0123456789abcdef" * 4)
    assert only(check_signing(one)) == ("pass", f"{tmp_path}/key is read, and the autopilot is heard with it")
    assert "not known" in only(check_signing(rover(tmp_path, SILENT, key="key")))[1]


def test_a_frame_that_was_signed_far_ahead_of_the_clock_is_told_with_what_to_do(tmp_path: Path) -> None:
    one = rover(tmp_path, HEARD, key="key")
    (tmp_path / "key").write_text("0123456789abcdef" * 4)
    (tmp_path / "key").chmod(0o600)
    store = TimestampFile(tmp_path)
    now = ticks(time.time())
    store.timestamps.check(SignedStream(255, 190, 0), now + DAY // 2, now)
    store.close()
    assert only(check_signing(one))[0] == "pass"
    store = TimestampFile(tmp_path)
    store.timestamps.check(SignedStream(254, 190, 0), now + 365 * DAY, now)
    store.close()
    verdict, text = only(check_signing(one))
    assert verdict == "warn"
    assert "365 days ahead" in text
    assert "delete signing.state" in text


@pytest.mark.parametrize(
    ("rejected", "verdict", "told"),
    [
        ({"unsigned": 3, "sender": 9}, "warn", "(unsigned 3): see its log"),
        (
            {"replay": 3},
            "warn",
            "(replay 3): see its log for the sender; if a station's clock was ahead once",
        ),
        ({"sender": 9}, "pass", "refused no frame"),
        (None, "pass", "refused no frame"),
    ],
)
def test_frames_that_a_companion_that_runs_refused_are_told(
    tmp_path: Path, rejected: Any, verdict: str, told: str
) -> None:
    found = only(check_signing(rover(tmp_path, running={"link": {"rejected": rejected}}, key="key")))
    assert (found[0], told in found[1]) == (verdict, True), found
