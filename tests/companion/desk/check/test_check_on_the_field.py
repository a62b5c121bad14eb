"""`companion check` as it is typed, against the real field, a real daemon and the real operator's client."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from companion.config import load_config, state_folder
from companion.daemon.trial_call import REQUEST
from companion.desk.check import here
from companion.desk.check.running import dry_run
from companion.desk.check.table import CHECKS, check
from companion.sim.demo.config import write_config
from companion.sim.demo.pace import SPEED
from companion.sim.demo.stage import DemoStage, set_stage
from tests.waiting import wait_for

PATIENCE = 30.0


@pytest.fixture(scope="module")
def field() -> Iterator[dict[str, Any]]:
    """A simulated rover's addresses."""
    command = [sys.executable, "-m", "companion.sim.field", "--seed", "1", "--speed", str(SPEED)]
    process = subprocess.Popen([*command, "--duration", "120"], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    yield json.loads(process.stdout.readline())
    process.terminate()
    process.wait(10.0)


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DemoStage]:
    """Field, daemon and operator."""
    made = set_stage(tmp_path_factory.mktemp("stage"), seed=1, auto=True)
    yield made
    made.close()


def rows(capsys: pytest.CaptureFixture[str]) -> dict[str, tuple[str, str]]:
    """Check -> verdict and text, from the last line."""
    said = json.loads(capsys.readouterr().out.splitlines()[-1])
    return {row["check"]: (row["verdict"], row["text"]) for row in said["checks"]}


def test_the_demo_s_rover_stops_before_what_it_sees_and_its_autopilot_is_asked(
    field: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = write_config(
        tmp_path,
        camera=f"field:{field['frames']}",
        link="udpout:127.0.0.1:9",
        policy="hold",
        speed=SPEED,
    )
    check(str(config), link=field["companion"], as_json=True)
    said = rows(capsys)
    assert said["stopping"][0] == "pass", said["stopping"]
    sound = ("config", "versions", "disk", "journal", "clock", "camera", "exposure", "perceiver", "link")
    assert [said[name] for name in sound if said[name][0] != "pass"] == []
    assert said["forwarding"][0] == "warn", "no ground station is connected"
    assert not any(name.startswith(("MIS_RESTART", "FS_ACTION", "SYSID")) for name in said)
    assert not (tmp_path / "state").exists(), "a check leaves nothing behind"


def test_an_autopilot_is_asked_where_it_is_heard_and_its_faster_cruise_counts(
    field: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("companion.desk.check.interview.HEARD_WITHIN", 1.2)
    nobody = "udpout:127.0.0.1:9"
    config = write_config(tmp_path, camera="folder:none", link=nobody, policy="hold", speed=SPEED - 1.0)
    config.write_text(f'{config.read_text()}\n[link.more.wire]\nurl = "{field["companion"]}"\n')
    check(str(config), as_json=True)
    said = [row for row in capsys.readouterr().out.splitlines() if row]
    assert any(row.startswith("warn  link") and f"not here: {nobody}" in row for row in said)
    assert any(
        row.startswith("pass  link") and f"{field['companion']}: an autopilot is heard" in row for row in said
    )
    assert any(f"CRUISE_SPEED says {SPEED:g} m/s" in row for row in said if "stopping" in row)


def test_a_wrong_configuration_is_a_row_that_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "companion.toml"
    path.write_text('[web]\nlisten = ""\n[vehicle]\nfile = ""\n[camera]\nrate = 0\n')
    assert check(str(path), as_json=True) == 1
    assert rows(capsys)["config"][0] == "fail"


def event(stage: DemoStage, heard: list[dict[str, Any]], name: str) -> Callable[[], Any]:
    """The first event of that name about a test, or about an answer."""

    def look() -> Any:
        heard.extend(json.loads(line) for _, line in stage.operator.lines())
        return next((one for one in heard if one["event"] == name and one.get("test", True)), None)

    return look


def test_a_dry_run_goes_to_the_operator_and_back_and_moves_nothing(
    stage: DemoStage, capsys: pytest.CaptureFixture[str]
) -> None:
    config = str(stage.out / "companion.toml")
    wait_for(lambda: stage.daemon_status().get("state") == "ok")
    codes: list[int] = []
    thread = threading.Thread(target=lambda: codes.append(dry_run(config, as_json=True)))
    thread.start()
    heard: list[dict[str, Any]] = []
    call = wait_for(event(stage, heard, "call"))
    assert (call["test"], call["reasons"], call["holding"]) == (True, [], False)
    stage.operator.type(f"{call['id']} go")
    closed = wait_for(event(stage, heard, "closed"))
    assert (closed["id"], closed["outcome"]) == (call["id"], "answered")
    thread.join(PATIENCE)
    assert codes == [0]
    last = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert last["ok"]
    assert last["test_call"]["by"] == [255, 190]
    assert f"C{call['id']} TEST answered by 255/190 after" in last["text"]
    assert stage.control.status()["mode_log"] == []


def test_beside_a_running_companion_the_check_leaves_its_link_alone(
    stage: DemoStage, capsys: pytest.CaptureFixture[str]
) -> None:
    wait_for(lambda: stage.daemon_status().get("state") == "ok")
    assert check(str(stage.out / "companion.toml"), as_json=True) == 0
    said = rows(capsys)
    assert said["autopilot"][0] == "skip"
    assert "owns the link" in said["autopilot"][1]
    assert said["link"] == ("pass", "the companion that runs hears the autopilot on main")
    assert said["exposure"][0] == "skip"
    assert said["forwarding"][0] in ("skip", "pass"), "pass: a test call was answered before"
    assert said["versions"][0] == said["disk speed"][0] == said["stopping"][0] == "pass"
    assert list(said) == [check.name for check in CHECKS], "a row for each check, in order"
    assert "in use by the companion" in said["journal"][1]
    assert said["camera"] == ("pass", "delivering, with the companion that runs")


def test_a_dry_run_without_a_companion_says_to_start_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = write_config(tmp_path, camera="folder:none", link="udpin:127.0.0.1:0", policy="hold")
    assert dry_run(str(config)) == 1
    assert "start the companion first" in capsys.readouterr().out


def test_a_dry_run_that_may_not_read_the_status_says_to_use_sudo(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def denied(path: Path) -> int:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(here, "open_regular", denied)
    config = write_config(tmp_path, camera="folder:none", link="udpin:127.0.0.1:0", policy="hold")
    assert dry_run(str(config)) == 1
    assert "may not be read: type this with sudo" in capsys.readouterr().out


def test_a_companion_that_does_not_react_is_not_waited_for_and_nothing_is_left(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("companion.desk.check.running.TAKEN_WITHIN", 0.3)
    config = write_config(tmp_path, camera="folder:none", link="udpin:127.0.0.1:0", policy="hold")
    (tmp_path / "state").mkdir()
    (tmp_path / "state" / "status.json").write_text("{}")
    assert dry_run(str(config)) == 1
    assert "does not react" in capsys.readouterr().out
    assert not (tmp_path / "state" / REQUEST).exists()


def test_a_status_file_that_is_old_or_torn_is_no_running_companion(tmp_path: Path) -> None:
    assert here.status(tmp_path) is None
    (tmp_path / "status.json").write_text("{")
    assert here.status(tmp_path) is None
    (tmp_path / "status.json").write_text('{"state": "ok"}')
    assert here.status(tmp_path) == {"state": "ok"}


def test_a_companion_that_ended_a_moment_ago_does_not_run(tmp_path: Path) -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait(PATIENCE)
    (tmp_path / "status.json").write_text(json.dumps({"pid": ended.pid}))
    assert here.status(tmp_path) is None
    (tmp_path / "status.json").write_text(json.dumps({"pid": os.getpid()}))
    assert here.status(tmp_path) == {"pid": os.getpid()}


def test_the_service_s_folder_is_meant_where_nothing_else_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "companion.toml"
    path.write_text('[web]\nlisten = ""\n[vehicle]\nfile = ""\n')
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    config = load_config(str(path))
    assert state_folder(config, service=tmp_path) == tmp_path
    assert state_folder(config, service=tmp_path / "none") == config.journal.path
    monkeypatch.setenv("STATE_DIRECTORY", "/elsewhere")
    assert state_folder(config, service=tmp_path) == Path("/elsewhere")
