"""A visit: the draft, what the pages are told, and what is written into the file."""

from __future__ import annotations

import json
import shlex
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, cast

import cv2
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from companion.cli import main, parser
from companion.config import ConfigError, load_config
from companion.desk.check.interview import Heartbeat, Interview
from companion.desk.check.watching import CameraDelivery
from companion.desk.setup import trial
from companion.desk.setup.command import login
from companion.desk.setup.draft import Draft
from companion.desk.setup.jobs import Job, Jobs
from companion.desk.setup.judging import LiveMap
from companion.desk.setup.parameters import AskedAutopilot
from companion.desk.setup.preview import PreviewPicture
from companion.desk.setup.session import SetupSession, next_steps
from companion.pages.requests import RequestError
from companion.sim.field.render import PinholeCamera
from companion.sim.field.things import World
from tests.companion.desk.ground.simulated import record
from tests.waiting import wait_for


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """The configuration that `companion init` writes."""
    assert main(["init", str(tmp_path)]) == 0
    return tmp_path / "companion.toml"


@pytest.fixture
def session(file: Path) -> Iterator[SetupSession]:
    made = SetupSession(file)
    yield made
    made.close()


def row(state: dict[str, Any], key: str) -> dict[str, Any]:
    found: dict[str, Any] = next(one for one in state["settings"] if one["key"] == key)
    return found


def test_nothing_is_changed_at_first_and_every_setting_has_its_meaning(session: SetupSession) -> None:
    state = session.state()
    assert (state["changed"], state["diff"]) == ([], "")
    assert row(state, "call.policy")["form"] == {
        "type": "choice",
        "options": ["report", "shadow", "hold", "guide"],
    }
    assert row(state, "call.policy")["guarded"]
    assert not row(state, "call.votes")["guarded"]
    assert all(one["help"] for one in state["settings"])
    assert state["words"]["grass"] == 1.0


def test_a_change_is_in_force_for_the_pages_at_once_and_in_the_file_only_when_written(
    session: SetupSession, file: Path
) -> None:
    before = file.read_text()
    state = session.change({"changes": {"mount.height": 0.8, "mount.tilt": 9.5}})
    assert state["changed"] == ["mount.height", "mount.tilt"]
    assert "+height = 0.8" in state["diff"]
    assert file.read_text() == before
    state = session.write({})
    assert (state["changed"], state["diff"]) == ([], "")
    assert "companion.toml.1" in state["written"]
    assert load_config(file).mount.height == 0.8
    with pytest.raises(RequestError, match="nothing is changed"):
        session.write({})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"mount.height": 1.0}, "height and tilt go together"),
        ({"mount.height": -1.0, "mount.tilt": 3.0}, "0.05 to 20"),
        ({"nothing.here": 1}, "not known"),
        ({"call.policy": "hold"}, "not known whether the vehicle stops"),
        ({"camera.source": "pipe:cat"}, "pixel_format|width"),
        ({"words": {"grass": 5}}, "1"),
        ({"words": 3}, "table"),
        ({"mount.height": {"a": 1}}, "number"),
        ({}, "1 to"),
        ([], "1 to"),
    ],
)
def test_a_change_with_a_problem_is_refused_whole_and_the_draft_stays(
    session: SetupSession, changes: Any, why: str
) -> None:
    session.change({"changes": {"camera.rate": 5.0}})
    with pytest.raises(RequestError, match=why):
        session.change({"changes": changes})
    assert session.state()["changed"] == ["camera.rate"]


@pytest.mark.parametrize(
    ("waiting", "changes", "taken"),
    [
        ({"mount.height": 1.0}, {"mount.tilt": 7.0}, ["mount.height", "mount.tilt"]),
        ({"mount.roll": 500.0, "mount.height": 1.0}, {"mount.tilt": 7.0}, ["mount.height", "mount.tilt"]),
        ({"roi.left": 0.9, "roi.bottom": 0.5}, {"roi.top": 0.3}, ["roi.bottom", "roi.top"]),
        ({"mount.height": None, "camera.width": 64}, {"camera.rate": 5.0}, ["camera.rate"]),
    ],
)
def test_what_was_refused_is_taken_along_with_what_makes_it_right(
    session: SetupSession, waiting: Any, changes: Any, taken: list[str]
) -> None:
    if "mount.tilt" not in changes:
        session.change({"changes": {"mount.height": 0.5, "mount.tilt": 5.0}})
    told = session.change({"changes": changes, "waiting": waiting})
    assert told["taken"] == taken
    assert told["refused"].keys() == waiting.keys() - taken
    with pytest.raises(RequestError, match="give a number"):
        session.change({"changes": {"mount.height": -1.0}, "waiting": waiting})
    with pytest.raises(RequestError, match="object"):
        session.change({"changes": changes, "waiting": [1]})


def test_a_file_that_somebody_else_changed_meanwhile_is_not_written_over(
    session: SetupSession, file: Path
) -> None:
    session.change({"changes": {"camera.rate": 5.0}})
    file.write_text(file.read_text().replace("rate = 10.0", "rate = 7.0", 1))
    with pytest.raises(RequestError, match="changed it meanwhile"):
        session.write({})
    assert load_config(file).camera.rate == 7.0
    assert "-rate = 7.0" in session.state()["diff"], "it is looked at as it is by now"
    session.write({})
    assert load_config(file).camera.rate == 5.0
    session.change({"changes": {"camera.rate": 6.0}})
    assert session.forget({})["written"] == "", "what is taken back is not written"


def test_of_a_file_that_somebody_else_has_broken_the_place_is_said(session: SetupSession, file: Path) -> None:
    file.write_text(file.read_text() + "\nrubbish\n")
    with pytest.raises(RequestError, match=rf"{file}:\d+: "):
        session.change({"changes": {"camera.rate": 5.0}})


def test_changes_are_taken_back_all_at_once(session: SetupSession) -> None:
    session.change({"changes": {"camera.rate": 5.0}})
    assert session.forget({})["changed"] == []
    assert session.draft.config.camera.rate == 10.0


def test_a_file_with_a_problem_is_mended_first(file: Path) -> None:
    file.write_text(file.read_text().replace("rate = 10.0", "rate = 0", 1))
    with pytest.raises(ConfigError):
        Draft(file)


def test_a_password_in_a_source_is_told_to_no_page(session: SetupSession) -> None:
    state = session.change({"changes": {"camera.source": "rtsp://me:secret@10.0.0.9/live"}})
    assert "secret" not in str(state)
    assert row(state, "camera.source")["hidden"]


def test_a_dragged_horizon_sets_height_and_tilt_together(session: SetupSession) -> None:
    assert "lines" in session.drag({"line": "horizon", "row": 0.35})
    assert session.state()["changed"] == [], "it is still being dragged"
    session.drag({"line": "horizon", "row": 0.35, "final": True})
    assert session.draft.config.mount.height == 1.0
    state = session.drag({"line": "2", "row": 0.8, "final": True})
    assert state["known"]
    session.drag({"line": "horizon", "row": 0.3, "final": True, "height": 0.7, "tilt": "rubbish"})
    assert session.draft.config.mount.height == 0.7, "it was typed, and waited for the tilt"
    for wrong in (
        {"line": "2", "row": "0.8"},
        {"line": 2, "row": 0.8},
        {"line": "2", "row": float("nan")},
        {},
    ):
        with pytest.raises(RequestError):
            session.drag(wrong)


@pytest.mark.slow
def test_a_weight_changes_the_judged_picture_at_once(file: Path) -> None:
    draft, live_map = Draft(file), LiveMap()
    world = World(0)
    frame, _ = PinholeCamera(world).render(world.trail.pose(20.0), 0.0)
    live = PreviewPicture(1, CameraDelivery(), cv2.imencode(".jpg", frame[..., ::-1])[1].tobytes())
    good = live_map.judge(draft.config, live, {"grass": 1.0, "dirt path": 1.0})
    first = live_map.jpeg
    bad = live_map.judge(draft.config, live, {"grass": -1.0, "dirt path": -1.0})
    assert good["ok"]
    assert good["shares"]["drivable"] > 0.4
    assert bad["shares"]["not drivable"] == good["shares"]["drivable"]
    assert live_map.jpeg != first
    assert "blocked" in bad["reasons"]
    with pytest.raises(RequestError, match="no picture"):
        live_map.judge(draft.config, PreviewPicture(), {"grass": 1.0})
    with pytest.raises(RequestError, match="camera's process"):
        live_map.judge(draft.config, PreviewPicture(2, CameraDelivery(), b"rubbish"), {"grass": 1.0})


def test_each_policy_is_checked_as_if_it_were_chosen(session: SetupSession) -> None:
    session.change({"changes": {"perceiver.name": "builtin:lexicon"}})
    found = {one["policy"]: one for one in session._policies()}
    assert list(found) == ["report", "shadow", "hold", "guide"]
    assert found["report"]["chosen"]
    assert any(
        "hold cannot be given" in one["text"] for one in found["hold"]["rows"] if one["verdict"] == "fail"
    )
    assert any(one["check"] == "guide" and "[mount] height" in one["text"] for one in found["guide"]["rows"])
    assert not any(one["check"] in ("disk", "heat") for one in found["hold"]["rows"])


def test_what_an_autopilot_told_counts_no_more_on_another_link(session: SetupSession) -> None:
    rover = Heartbeat(1, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, mavlink.MAV_TYPE_GROUND_ROVER)
    url = session.draft.config.link.url
    session._read = AskedAutopilot(url, cast("Interview", None), rover, "")
    assert session._asked(session.draft.config) is session._read
    session.change({"changes": {"link.url": "udpin:127.0.0.1:14999"}})
    with pytest.raises(RequestError, match="read the autopilot"):
        session._parameter({"name": "MIS_RESTART", "before": 1.0, "after": 0.0})


def test_no_parameter_is_set_that_was_not_proposed(session: SetupSession) -> None:
    with pytest.raises(RequestError, match="read the autopilot"):
        session._parameter({"name": "MIS_RESTART", "before": 1.0, "after": 0.0})


def test_a_job_tells_its_result_its_problem_or_that_it_is_late() -> None:
    gate: list[int] = []

    def waits(_told: object) -> str:
        wait_for(lambda: gate)
        return "well"

    def refuses(_told: object) -> None:
        raise RequestError("no")

    jobs = Jobs({"waits": Job(waits, 60.0), "late": Job(waits, 0.0), "refuses": Job(refuses, 1.0)})
    assert jobs.document("waits") == {"state": "idle"}
    assert jobs.start("waits", {})["state"] == "running"
    with pytest.raises(RequestError, match="still runs"):
        jobs.start("waits", {})
    jobs.start("late", {})
    time.sleep(0.01)
    assert "did not end" in jobs.document("late")["problem"]
    gate.append(1)
    wait_for(lambda: jobs.document("waits").get("result") == "well")
    jobs.start("refuses", {})
    wait_for(lambda: jobs.document("refuses").get("problem") == "no")
    with pytest.raises(RequestError, match="no job"):
        jobs.start("rm", {})


def test_a_secret_that_is_not_set_is_not_said_to_be(session: SetupSession, file: Path) -> None:
    assert not row(session.state(), "web.token")["hidden"]
    file.chmod(0o600)
    state = session.change({"changes": {"web.token": "a-token-of-24-characters"}})
    assert row(state, "web.token")["hidden"]
    assert "a-token-of-24" not in str(state)


@pytest.mark.slow
def test_a_recorded_drive_proposes_the_mount(session: SetupSession, tmp_path: Path) -> None:
    folder = tmp_path / "state"
    session.change({"changes": {"journal.folder": str(folder), "camera.view": 75.0}})
    assert not session.state()["recorded"]
    (folder / "recordings").mkdir(parents=True)
    record(folder / "recordings" / "000001.mcap", 0, frames=60)
    assert session.state()["recorded"]
    session.jobs.start("estimate", {})
    wait_for(lambda: session.jobs.document("estimate")["state"] != "running", 180.0)
    told = session.jobs.document("estimate")
    assert told["result"]["tilt"] == pytest.approx(7.0, abs=0.3)
    assert told["result"]["height"] == pytest.approx(1.0, abs=0.05)


@pytest.mark.slow
def test_a_test_call_wants_a_companion_that_runs(session: SetupSession, tmp_path: Path) -> None:
    session.change({"changes": {"journal.folder": str(tmp_path / "state")}})
    session.write({})
    told = trial.raise_test_call(session.draft.file)
    assert not told["answered"]
    assert "start the companion first" in str(told["said"])


@pytest.mark.slow
def test_a_test_call_imports_nothing_of_the_current_folder(
    session: SetupSession, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "companion").mkdir()
    (tmp_path / "companion" / "__main__.py").write_text("print('of somebody else')\n")
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    assert "start the companion first" in str(trial.raise_test_call(session.draft.file)["said"])


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=5,
)
NAMED = (
    "camera.source camera.rate call.policy words words.grass vocabulary aliases.grass link.url mount.height "
    "link.allowed_senders link.more.wifi.url thresholds.tile perceiver.providers"
)
KEYS = st.sampled_from(NAMED.split()) | st.text(max_size=12)


@pytest.mark.slow
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.dictionaries(KEYS, VALUES, min_size=1, max_size=3))
def test_whatever_is_posted_is_refused_or_leaves_a_valid_draft(
    session: SetupSession, changes: dict[str, Any]
) -> None:
    with suppress(RequestError):
        session.change({"changes": json.loads(json.dumps(changes))})
    session.forget({})
    assert session.state()["changed"] == []


def test_what_comes_next_is_typed_for_the_service_or_by_hand() -> None:
    by_hand = [command for _, command in next_steps(Path("/home/me/my rover/companion.toml"))]
    assert by_hand[-1] == "companion run '/home/me/my rover/companion.toml'"
    service = [command for _, command in next_steps(Path("/etc/anytraverse/companion.toml"))]
    assert all(command.startswith("sudo ") for command in service)
    assert service[1:] == ["sudo systemctl restart companion", "sudo systemctl enable companion"]
    for command in by_hand:
        parser().parse_args(shlex.split(command)[1:])


def test_ssh_is_for_who_typed_sudo(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SUDO_USER", "pi")
    assert login().startswith("pi@")
    monkeypatch.delenv("SUDO_USER")
    monkeypatch.setenv("LOGNAME", "me")
    assert login().startswith("me@")
