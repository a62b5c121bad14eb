"""Loading and warming up, too slow a perceiver, and what runs: from the configuration to what is told."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray
from pymavlink.dialects.v20 import development as mavlink

from anytraverse.engine import AnyTraverse
from anytraverse.errors import AnyTraverseError, PerceiverError
from anytraverse.frame import Image
from anytraverse.history import Entry, History
from anytraverse.judging import Settings
from anytraverse.memory import first_memory
from anytraverse.pace import Pace
from anytraverse.perception import Perceiver, Prompt
from anytraverse.perception.runtime import Runtime
from anytraverse.preferences import Preferences
from companion import run
from companion.cameras.newest import CameraStatus
from companion.cli import main as cli
from companion.config import Config, load_config
from companion.config.link_settings import LinkSettings
from companion.config.schema import MountSection, StoppingSection
from companion.daemon.startup import load
from companion.sim.loopback_link import LoopbackLink
from companion.system.service_manager import ServiceManager
from companion.vision import process
from companion.vision import warm_up as warm_up_module
from companion.vision.codec import Splitter, decode, encode_trusted
from companion.vision.messages import Alive, Failed, Model, Start
from companion.vision.warm_up import too_slow, warm_up
from companion.wire.answers import Answer
from companion.wire.ids import Policy
from tests.anytraverse.conftest import Painted
from tests.companion.daemon.rig import MakeRig
from tests.companion.processes import heard, painted_config
from tests.companion.vision import painted
from tests.companion.vision.played import loading

PATIENCE = 10.0


class Slow(Painted):
    """A tenth of a second a frame. It notes what it was asked for."""

    def __init__(self, seconds: float = 0.1) -> None:
        super().__init__()
        self.seconds = seconds
        self.asked: list[tuple[str, ...]] = []

    def encode(self, image: Image) -> Image:
        """The picture itself, after a while."""
        time.sleep(self.seconds)
        return super().encode(image)

    def attend(self, features: Image, prompts: Sequence[Prompt]) -> NDArray[np.float32]:
        """As painted."""
        self.asked.append(tuple(prompt.word for prompt in prompts))
        return super().attend(features, prompts)


def engine_of(perceiver: Perceiver) -> AnyTraverse:
    """Of a rover that was never out."""
    return AnyTraverse(
        perceiver, Settings(), first_memory(perceiver.model_id, Preferences.parse("grass: 1; rock: -1"))
    )


def test_warming_up_measures_a_whole_step_and_leaves_the_engine_as_it_is() -> None:
    perceiver = Slow(0.02)
    engine = engine_of(perceiver)
    memory = engine.memory
    assert 0.02 <= warm_up(engine) < 0.2
    assert perceiver.embedded == perceiver.encoded == len(perceiver.asked) >= 3
    assert engine.memory is memory
    assert engine.newest is None


def test_words_that_may_come_by_themselves_are_prepared_and_unknown_ones_left_out() -> None:
    perceiver = Slow(0.0)
    warm_up(engine_of(perceiver), ["grass", "drum", "unicorn", "drum", "trail"])
    assert perceiver.asked[0] == ("drum", "trail")
    assert set(perceiver.asked[1:]) == {("grass", "rock")}


def test_a_slow_perceiver_is_not_measured_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warm_up_module, "_LONG_ENOUGH", 0.0)
    perceiver = Slow(0.0)
    warm_up(engine_of(perceiver))
    assert perceiver.encoded == 3


def test_a_perceiver_that_fails_on_frames_is_started_with_its_log_saying_so(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(_: Image) -> Image:
        raise PerceiverError("the image network's output is not finite")

    perceiver = Painted()
    monkeypatch.setattr(perceiver, "encode", broken)
    assert warm_up(engine_of(perceiver)) < 0.1
    assert "output is not finite" in caplog.text


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (MemoryError(), "does not fit into memory: stop other programs"),
        (PerceiverError("ONNX Runtime cannot load image.onnx: bad"), "cannot load image.onnx"),
    ],
)
def test_what_cannot_be_loaded_is_told_with_what_to_do(
    monkeypatch: pytest.MonkeyPatch, config: Config, error: Exception, told: str
) -> None:
    def broken(*_: object) -> None:
        raise error

    monkeypatch.setattr(process, "load_and_warm_up", broken)
    monkeypatch.setattr(process, "CameraThread", lambda *_, **__: None)
    ours, theirs = socket.socketpair()
    with ours, theirs, loading() as (vision, child):
        vision.poll(time.monotonic())
        ours.sendall(encode_trusted(Start(config, None, 0, 1)))
        process._serve(process.SupervisorChannel(theirs))
        failed = [decode(packed) for packed in Splitter().feed(ours.recv(1 << 20))][-1]
        assert isinstance(failed, Failed)
        child.report(failed)
        with pytest.raises(AnyTraverseError, match=told):
            load(vision, LoopbackLink().link, lambda: False, ServiceManager({}))


def test_whoever_wants_something_while_it_loads_is_told_to_ask_again() -> None:
    stage = LoopbackLink(LinkSettings("udpout:127.0.0.1:14550", pace=0.0))
    for wish in (
        mavlink.MAVLink_command_long_message(1, 191, 31010, 0, 0, 5, 3, 0, 0, 0, 0),
        mavlink.MAVLink_command_long_message(1, 191, 245, 0, 2, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_param_set_message(1, 191, b"AT_W_GRASS", 0.5, 9),
        mavlink.MAVLink_param_ext_set_message(1, 191, b"AT_WORDS", b"grass: 0.5", 11),
    ):
        stage.send(wish)
    with loading() as (vision, _):
        turns = iter(range(10))
        assert load(vision, stage.link, lambda: next(turns) == 9, ServiceManager({})) is None
    stage.collect(0.0)
    assert [(m.command, m.result) for m in stage.sent("COMMAND_ACK")] == [(31010, 1), (245, 1)]
    assert [(m.param_id, m.param_value) for m in stage.sent("PARAM_VALUE")] == [("AT_W_GRASS", 1.0)]
    assert [m.param_result for m in stage.sent("PARAM_EXT_ACK")] == [2]
    assert [m.text for m in stage.sent("STATUSTEXT")] == ["Refused: starting, send it again"]
    stage.now = time.monotonic()
    stage.send(mavlink.MAVLink_param_ext_set_message(1, 191, b"AT_WORDS", b"grass: 0.5", 11))
    stage.run(0.1)
    assert len(stage.reported(Answer)) == 1, "and then it counts"


def test_too_slow_is_told_with_figures_and_remedies() -> None:
    told = too_slow(Pace(0.62, 0.1, 1.0))
    for part in ("0.62 s", "1.34 s old", "T = 1.00 s", "--size", "int8", "[camera] rate", "freshness = 1.4"):
        assert part in told
    assert "freshness" not in too_slow(Pace(20.0, 1.0, 2.0)), "more than the configuration takes"


@pytest.fixture
def config(tmp_path: Path, radio: socket.socket) -> Config:
    """A camera that shows nothing, and a wish to hold: T = 0.2 s at 50 frames/s."""
    hold = 'rock = -1.0\n[call]\npolicy = "hold"\nfreshness = 0.2\n[stopping]\nunchecked = true'
    lines = {"top": 'vocabulary = ["drum"]', "camera": "rate = 50", "more": hold}
    path = painted_config(tmp_path, radio.getsockname()[1], [], **lines)
    painted.register()
    return load_config(str(path))


def run_until_status(
    config: Config, fits: Callable[[dict[str, Any]], bool] = lambda _: True
) -> dict[str, Any]:
    """What the status file says once it fits."""
    path = config.journal.path / "status.json"
    deadline = time.monotonic() + PATIENCE

    def stop() -> bool:
        return (path.is_file() and fits(json.loads(path.read_text()))) or time.monotonic() > deadline

    assert run.main(config, stop, vision=painted.COMMAND) == 0
    status = json.loads(path.read_text())
    assert isinstance(status, dict)
    return status


@pytest.mark.slow
def test_a_perceiver_that_cannot_keep_t_lowers_no_policy_and_hold_is_refused_to_who_asks(
    config: Config,
) -> None:
    slow = replace(config, perceiver=replace(config.perceiver, name="painted:0.1"))
    status = run_until_status(slow, lambda status: status["link"]["sent"]["unsolicited"] > 100)
    assert (status["policy"], status["state"]) == ("hold", "fault")
    assert status["hold_refused"] == "HOLD refused: 0.1 s a frame: make it faster"


def test_a_perceiver_that_keeps_t_may_hold(config: Config, radio: socket.socket) -> None:
    status = run_until_status(config)
    assert (status["policy"], status["hold_refused"]) == ("hold", "")
    assert b"s a frame" not in heard(radio), "on a busy computer the camera, which shows nothing, may be told"


def mounted(config: Config, speed: float) -> Config:
    """With a camera whose mount is known, on a vehicle of that speed."""
    stopping = StoppingSection(speed=speed, time_constant=0.1, braking=1.0)
    return replace(config, mount=MountSection(height=1.0, tilt=10.0), stopping=stopping)


@pytest.mark.slow
def test_a_vehicle_that_outruns_its_eyes_is_a_fault_in_policy_hold_and_says_which_speed_would_fit(
    config: Config, radio: socket.socket, caplog: pytest.LogCaptureFixture
) -> None:
    slow = mounted(config, 4.0)
    status = run_until_status(slow, lambda status: status["link"]["sent"]["unsolicited"] > 100)
    assert (status["policy"], status["state"]) == ("hold", "fault")
    assert status["hold_refused"] == "HOLD refused: 4.0 m/s outruns eyes: at most 1.3"
    assert b"FAULT: 4.0 m/s: at most 1.3, or AT_POLICY 0" in heard(radio)
    assert "hold cannot be given: at 4 m/s it takes" in caplog.text


@pytest.mark.slow
def test_a_vehicle_that_stops_before_what_it_sees_may_hold(config: Config, radio: socket.socket) -> None:
    status = run_until_status(mounted(config, 1.0))
    assert (status["policy"], status["hold_refused"]) == ("hold", "")
    assert b"not checked" not in heard(radio)


@pytest.mark.slow
def test_a_stopping_distance_that_nobody_could_check_is_told_once_at_the_start(
    config: Config, radio: socket.socket, caplog: pytest.LogCaptureFixture
) -> None:
    run_until_status(config, lambda status: status["link"]["sent"]["unsolicited"] > 300)
    assert heard(radio).count(b"Stopping not checked") == 1
    assert "was not checked: set [mount] height and tilt" in caplog.text


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mount", "stopping", "named"),
    [
        (MountSection(), StoppingSection(), "set [mount] height and tilt, and [stopping] speed"),
        (MountSection(), StoppingSection(speed=1.0), "set [mount] height and tilt"),
        (MountSection(height=1.0, tilt=10.0), StoppingSection(), "set [stopping] speed"),
    ],
)
def test_policy_hold_without_the_figures_for_stopping_runs_in_fault_and_names_them(
    config: Config,
    radio: socket.socket,
    caplog: pytest.LogCaptureFixture,
    mount: MountSection,
    stopping: StoppingSection,
    named: str,
) -> None:
    blind = replace(config, mount=mount, stopping=stopping)
    status = run_until_status(blind, lambda status: status["link"]["sent"]["unsolicited"] > 100)
    assert (status["policy"], status["state"]) == ("hold", "fault")
    assert status["hold_refused"] == "HOLD refused: set [mount] and [stopping]"
    assert b"FAULT: set [mount], [stopping], or AT_POLICY 0" in heard(radio)
    assert f"{named}. Or allow hold without that check: set [stopping] unchecked = true" in caplog.text


def test_the_check_of_a_configuration_with_policy_hold_wants_the_figures_for_stopping(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "companion.toml"
    path.write_text('[web]\nlisten = ""\n[vehicle]\nfile = ""\n[call]\npolicy = "hold"\n')
    assert cli(["config", "check", str(path)]) == 2
    assert "set [mount] height and tilt, and [stopping] speed" in capsys.readouterr().err


def test_the_ground_may_not_set_hold_where_nobody_knows_whether_it_stops_in_time(make_rig: MakeRig) -> None:
    rig = make_rig(Policy.REPORT)
    rig.config = Config()
    rig.restart()
    rig.set("AT_POLICY", float(Policy.HOLD))
    rig.see(1.0)
    assert rig.told_policy is Policy.REPORT
    assert rig.echoes("AT_POLICY")[-1] == float(Policy.REPORT)
    rig.stage.send(
        mavlink.MAVLink_command_long_message(1, 191, 31010, 0, 0, 5, float(Policy.HOLD), 0, 0, 0, 0)
    )
    rig.see(1.0)
    assert rig.told_policy is Policy.REPORT
    assert rig.stage.sent("COMMAND_ACK")[-1].result == mavlink.MAV_RESULT_FAILED
    assert "HOLD refused: set [mount] and [stopping]" in rig.texts


def test_long_work_gives_signs_of_life(monkeypatch: pytest.MonkeyPatch, config: Config) -> None:
    def prepare(name: str, runtime: Runtime) -> Perceiver:
        for _ in range(3):
            runtime.progress()
        raise PerceiverError(f"{name} cannot be loaded")

    def camera(*_: object, **__: object) -> SimpleNamespace:
        return SimpleNamespace(status=CameraStatus(), delivered_at=None)

    monkeypatch.setattr(warm_up_module, "make_perceiver", prepare)
    monkeypatch.setattr(process, "CameraThread", camera)
    ours, theirs = socket.socketpair()
    with ours, theirs:
        ours.sendall(encode_trusted(Start(config, None, 0, 1)))
        process._serve(process.SupervisorChannel(theirs))
        sent = [decode(packed) for packed in Splitter().feed(ours.recv(1 << 20))]
    assert [type(report) for report in sent] == [Alive, Alive, Alive, Failed]


def test_remembered_and_offered_words_are_prepared_before_the_first_frame(
    config: Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    perceiver = Slow(0.0)
    words = Preferences.parse("grass: 1; trail: 1")
    memory = first_memory(perceiver.model_id, config.preferences)
    entry = Entry(np.array([1, 0], dtype=np.float32), words, 1, 1)
    monkeypatch.setattr(warm_up_module, "make_perceiver", lambda *_: perceiver)
    warm_up_module.load_and_warm_up(config, replace(memory, history=History([entry])))
    assert perceiver.asked[0] == ("drum", "trail")


def test_the_ground_may_not_set_hold_with_too_slow_a_perceiver(make_rig: MakeRig) -> None:
    rig = make_rig(Policy.REPORT)
    rig.step_time = 0.6
    rig.restart()
    rig.set("AT_POLICY", float(Policy.HOLD))
    rig.see(1.0)
    assert rig.daemon.status.figures()["policy"] == "report"
    assert rig.told_policy is Policy.REPORT
    assert rig.echoes("AT_POLICY")[-1] == float(Policy.REPORT)
    assert "HOLD refused: 0.6 s a frame: make it faster" in rig.texts
    rig.set("AT_POLICY", float(Policy.SHADOW))
    rig.see(0.5)
    assert rig.daemon.status.figures()["policy"] == "shadow"


def test_the_variant_that_runs_is_known_with_its_reason() -> None:
    manifest = SimpleNamespace(variants={"fp32": {}, "int8": {}})
    perceiver = SimpleNamespace(model_id="m-1", precision="fp32", why="int8: not checked", manifest=manifest)
    assert Model.of(cast(Perceiver, perceiver)) == Model("m-1", "fp32", "int8: not checked", int8_idle=True)
    assert str(Model.of(cast(Perceiver, perceiver))) == "m-1, fp32: int8: not checked"
    assert str(Model.of(Painted())) == "painted-1"


def test_the_end_does_not_wait_for_a_thread_that_was_left_behind() -> None:
    script = (
        "import threading, time, companion.cli as cli\n"
        "threading.Thread(target=time.sleep, args=(60,), daemon=True).start()\n"
        "cli._leave(3)\n"
        "raise SystemExit('still here')"
    )
    ended = subprocess.run([sys.executable, "-c", script], timeout=30, check=False)
    assert ended.returncode == 3


def test_the_end_does_not_wait_for_a_log_that_hangs_in_its_file() -> None:
    script = (
        "import logging, threading, time, companion.cli as cli\n"
        "file = logging.StreamHandler()\n"
        "threading.Thread(target=lambda: file.acquire() or time.sleep(60), daemon=True).start()\n"
        "cli._leave(3)\n"
        "raise SystemExit('still here')"
    )
    ended = subprocess.run([sys.executable, "-c", script], timeout=10, check=False)
    assert ended.returncode == 3
