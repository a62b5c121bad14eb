"""Real processes on the simulated trail, a run of each kind: what happened, not how quickly.

How quickly is judged by `make bench-stopping`, on a machine that does nothing else.
"""

from __future__ import annotations

import os
import socket
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, nullcontext
from dataclasses import replace
from itertools import count
from pathlib import Path
from random import Random
from typing import Any
from unittest.mock import MagicMock

import pytest

from bench.faults import by_hand
from bench.stopping.appearing import Appeared
from bench.stopping.appearing import figures as appearing_figures
from bench.stopping.figures import figures, good
from bench.stopping.jobs import FAST, LATE, Job, Run
from bench.stopping.limits import SPARE, Limit, braking, script_timeout
from bench.stopping.runs import GROUPS, untested
from bench.stopping.scenes import SCENES, Seen, StoppingScene, follows
from bench.stopping.serial_device import FAR_BUFFER, SerialDevice
from bench.stopping.stage import Disturbed, Plan, Stage
from bench.stopping.stops import Stop, stopped
from companion.config import load_config
from companion.config.link_settings import read_url
from companion.config.stopping import Stopping, judge_stopping
from companion.link.streams import Serial
from companion.sim.demo.config import write_config
from companion.sim.demo.rehearsal import free_port
from companion.wire.ids import Policy, State

pytest.importorskip("lupa.lua53", reason="the script on the autopilot runs in Lua 5.3")

SEEDS = (1,)
LONG = ("by_hand",)
"""Groups that the tests leave out, since a scene takes up to a minute."""
AT_ONCE = 3
"""More would starve each other on two cores: rovers are then held before their fault, and begin anew."""
KINDS = {
    "frozen_camera": {"companion", "script"},
    "frozen_with_clock": {"companion", "script"},
    "silent_camera": {"companion", "script"},
    "nan_maps": {"companion", "script"},
    "hung_perceiver": {"companion", "script"},
    "vision_segfault": {"companion", "script"},
    "vision_lock_hang": {"companion", "script"},
    "vision_out_of_memory": {"companion", "script"},
    "reversing": {"companion", "script"},
    "slow_frames": {"companion", "script"},
    "slow_disk": {"companion", "script"},
    "spoofed_peers": {"companion", "script"},
    "answer_flood": {"companion", "script"},
    "one_way_wire": {"script"},
    "sigstop": {"script"},
    "dead_link": {"script"},
    "kill_9": {"script"},
    "human": {"companion"},
    "alien_place": {"companion", "script"},
}
"""Every kind that ends in standstill, and who may have held; the script also acts on a fault that is told."""


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[list[Run]]:
    """All of them, side by side."""
    out, cancelled = tmp_path_factory.mktemp("stopping"), threading.Event()
    with pytest.MonkeyPatch.context() as patched, ThreadPoolExecutor(AT_ONCE) as pool:
        patched.setenv("PYTHONPATH", str(Path(__file__).parents[2]))
        jobs = [
            (group, Job(seed, out / name, cancelled))
            for seed in SEEDS
            for name, group in GROUPS.items()
            if name not in LONG
        ]
        try:
            yield [run for found in pool.map(lambda job: list(job[0](job[1])), jobs) for run in found]
        finally:
            cancelled.set()


@pytest.mark.parametrize("kind", KINDS)
def test_a_driving_rover_is_stopped(runs: list[Run], kind: str) -> None:
    own = [run for run in runs if run.kind == kind]
    assert [run.seed for run in own] == list(SEEDS)
    for run in own:
        assert run.wrong in ("", LATE), run
        assert run.stop is not None
        assert run.stop.stands
        assert run.stop.by in KINDS[kind]


def test_a_rover_in_report_policy_is_never_commanded(runs: list[Run]) -> None:
    own = [run for run in runs if run.kind == "report"]
    assert [(run.seed, run.wrong, run.commanded) for run in own] == [(seed, "", 0) for seed in SEEDS]


def test_no_kind_is_left_out(runs: list[Run]) -> None:
    assert {run.kind for run in runs} == {*KINDS, "report"}


def test_the_limit_is_made_of_the_script_s_own_figure_and_the_rover_s_own_brakes() -> None:
    assert script_timeout() == 1.5
    seconds, metres = braking(1.84)
    assert seconds == pytest.approx(6.2, abs=0.1)
    assert metres == pytest.approx(3.5, rel=0.02), "as ArduPilot"
    limit = Limit(1.0, 1.5, 1.84)
    assert limit.seconds == 2.5 + SPARE + seconds
    assert limit.metres == pytest.approx((2.5 + SPARE) * 1.84 + 3.5, abs=0.02)


def test_what_the_bench_drives_at_is_what_check_passes(tmp_path: Path) -> None:
    for top in ("top = 0.46", "top = 0.44"):
        path = write_config(
            tmp_path, camera="field:127.0.0.1:1", link="udpout:127.0.0.1:9", policy="hold", speed=FAST
        )
        path.write_text(path.read_text().replace("top = 0.46", top))
        for tile in (0.65, None) if top == "top = 0.44" else (0.65,):
            judged = judge_stopping(load_config(str(path)), step=0.05, tile=tile)
            assert isinstance(judged, Stopping)
            assert judged.enough, judged.describe()


LIMIT = Limit(1.0, 0.5, 0.6)


def stop(seconds: float, *, stands: bool = True) -> Stop:
    return Stop(stands, seconds, seconds, limit=LIMIT, speed=0.6, zone="meadow", by="script")


def test_a_rover_that_is_late_or_goes_too_far_or_drives_on_or_is_commanded_spoils_the_bench() -> None:
    well = Run("kill_9", 1, "", stop(2.0))
    late = Run("kill_9", 2, LATE, stop(LIMIT.seconds + 0.1))
    gone = Run("kill_9", 3, "not stopped", stop(11.0, stands=False))
    quiet, commanded = Run("report", 1), Run("report", 2, "COMMAND_LONG 176 1 4", None, 1)
    assert good([well, quiet])
    assert not any(good([well, bad]) for bad in (late, gone, commanded))
    assert not good([])
    found = figures([well, late, gone, quiet, commanded])
    assert (found["runs"], found["stopped"], found["commanded_in_report_policy"]) == (3, 1, 1)
    assert (found["worst_seconds"], found["worst_metres"]) == (11.0, 11.0)
    assert (found["limit_seconds"], found["limit_metres"]) == (
        round(LIMIT.seconds, 2),
        round(LIMIT.metres, 2),
    )
    assert found["kinds"]["kill_9"]["wrong"] == 2
    assert not replace(stop(2.0), metres=LIMIT.metres + 0.1).stopped


def status(t: float, mode: str, speed: float, by: str = "companion") -> dict[str, Any]:
    log = [{"t": 3.0, "mode": "HOLD", "by": by}] if mode == "HOLD" else []
    return {
        "t": t,
        "monotonic": t,
        "mode": mode,
        "speed": speed,
        "distance": 0.6 * t,
        "zone": "meadow",
        "mode_log": log,
    }


def test_only_one_that_was_held_and_goes_on_standing_has_stopped() -> None:
    driving, standing = status(2.0, "AUTO", 0.6), status(4.0, "HOLD", 0.0)
    assert stopped(driving, standing, LIMIT, status(4.5, "HOLD", 0.0)).stopped
    assert not stopped(driving, status(14.0, "HOLD", 0.0), LIMIT).stopped
    assert not stopped(driving, standing, LIMIT, status(4.5, "AUTO", 0.4)).stands
    assert not stopped(driving, status(4.0, "AUTO", 0.0), LIMIT).stands
    assert not stopped(driving, status(4.0, "HOLD", 0.0, by="hand"), LIMIT).stands


def test_a_lap_without_orders_proves_nothing_where_nothing_went_wrong_or_holding_was_allowed() -> None:
    told = {(state, Policy.REPORT) for state in (State.STARTING, State.OK, State.CALLING, State.FAULT)}
    assert untested(told) == ""
    assert untested(told - {(State.FAULT, Policy.REPORT)}) == "it never told fault"
    assert untested(set())
    assert "policy report" in untested(told | {(State.OK, Policy.HOLD)})


def test_a_lap_and_a_scene_have_no_stop_and_count_as_they_went() -> None:
    found = figures([Run("mode_at_resume", 1, saw="MANUAL"), Run("mode_at_resume", 2, "then AUTO")])
    assert (found["runs"], found["stopped"]) == (0, 0)
    assert found["kinds"]["mode_at_resume"]["wrong"] == 1
    assert found["kinds"]["mode_at_resume"]["saw"] == {"MANUAL": 1}


def test_a_scene_that_is_disturbed_is_begun_anew_and_what_does_not_follow_is_wrong_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    played: list[str] = []

    def scene(name: str, *ends: str) -> StoppingScene:
        def play(_stage: Stage, _random: Random) -> Seen:
            played.append(name)
            end = ends[min(played.count(name), len(ends)) - 1]
            with follows() if end == "missing" else nullcontext():
                if end != "well":
                    raise Disturbed(end)
            return Seen(saw=end)

        return StoppingScene(Job.plan, play)

    monkeypatch.setattr(Job, "stage", lambda *_: nullcontext())
    scenes = {"well": scene("well", "held", "well"), "missing": scene("missing", "missing")}
    monkeypatch.setattr("bench.stopping.runs.SCENES", scenes)
    assert list(GROUPS["by_hand"](Job(1, tmp_path, threading.Event()))) == [
        Run("well", 1, disturbed=1, saw="well"),
        Run("missing", 1, "missing"),
    ]
    assert played == ["well", "well", "missing"]


DEADLINE = 20.0
DRIVES_ON = "COMMAND_LONG 176 1 10"


def stage_with(then: str, metres: float, sends: str, *, script: bool) -> Any:
    """A stage on which nothing takes time. then: the mode after a human's. sends: what a go makes it send.

    metres: from one look to the next.
    """
    stage, looks = MagicMock(), count()
    stage.plan, stage.wire.commands = Plan(1, 0.0, script=script), []
    stage.read_status.return_value = {"current_id": 7}
    stage.ground.go.side_effect = lambda _: stage.wire.commands.extend([sends] * bool(sends))
    modes = ["HOLD"]
    stage.control.mode.side_effect = lambda _: modes.append(then)
    stage.status.side_effect = lambda: {
        "mode": modes[-1],
        "speed": 0.0,
        "distance": metres * next(looks),
        "mode_log": [{"by": "script"}],
    }
    return stage


@pytest.mark.parametrize("script", [False, True])
@pytest.mark.parametrize(
    ("kind", "then", "metres", "sends", "wrong"),
    [
        ("driven_on", "AUTO", 1.0, "", ""),
        ("driven_on", "HOLD", 0.0, "", "held again at once by script"),
        ("driven_on", "AUTO", 5.0, "", "and 15.0 m"),
        ("mode_at_resume", "MANUAL", 0.0, DRIVES_ON, ""),
        ("mode_at_resume", "AUTO", 0.0, DRIVES_ON, "MANUAL by hand, then AUTO"),
        ("mode_at_resume", "HOLD", 0.0, DRIVES_ON, "with the script: MANUAL by hand, then HOLD"),
        ("mission_complete", "", 0.0, "", ""),
        ("mission_complete", "", 0.0, DRIVES_ON, DRIVES_ON),
        ("mission_complete", "", 1.0, "", "it drove off: 1.0 m"),
        ("serial_stuck", "MANUAL", 0.0, "", ""),
        ("serial_stuck", "MANUAL", 0.0, DRIVES_ON, DRIVES_ON),
        ("serial_stuck", "AUTO", 0.0, "", "then AUTO"),
    ],
)
def test_a_scene_is_wrong_where_a_human_is_overruled_or_it_drives_on_by_itself(
    kind: str, then: str, metres: float, sends: str, wrong: str, script: bool
) -> None:
    stage = stage_with(then, metres, sends, script=script)
    seen = SCENES[kind].play(stage, Random(1))
    if wrong.startswith("with the script") and not script:
        wrong = ""
    assert (bool(seen.wrong), wrong in seen.wrong) == (bool(wrong), True), seen


def test_every_scene_is_a_row_of_the_fault_table_and_only_the_serial_one_has_such_a_device(
    tmp_path: Path,
) -> None:
    assert len(by_hand.ROWS) == len(SCENES)
    plans = {
        kind: scene.plan(Job(2, tmp_path, threading.Event()), Random(1)) for kind, scene in SCENES.items()
    }
    assert [kind for kind, plan in plans.items() if plan.serial] == ["serial_stuck"]


def test_a_serial_device_that_is_stuck_takes_nothing_and_then_all_again() -> None:
    port = free_port()
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as autopilot,
        closing(SerialDevice(port)) as device,
        open(device.url.split(":")[1], "r+b", buffering=0, opener=non_blocking) as companion,
    ):
        autopilot.settimeout(DEADLINE)
        autopilot.sendto(b"heard", ("127.0.0.1", port))
        until = time.monotonic() + DEADLINE
        while companion.read(8) != b"heard":
            assert time.monotonic() < until
        companion.write(b"taken")
        assert autopilot.recv(64) == b"taken"
        device.stuck = True
        while companion.write(b"kept") is not None:
            assert time.monotonic() < until, "it takes bytes"
        device.stuck = False
        while b"again" not in autopilot.recv(8192):
            companion.write(b"again")
            assert time.monotonic() < until


@pytest.mark.parametrize("recalled", [False, True])
def test_a_serial_device_that_keeps_what_it_took_passes_it_late_where_it_is_not_taken_back(
    recalled: bool,
) -> None:
    port = free_port()
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as autopilot,
        closing(SerialDevice(port)) as device,
        closing(Serial(read_url(device.url))) as companion,
    ):
        autopilot.settimeout(DEADLINE)
        autopilot.sendto(b"heard", ("127.0.0.1", port))
        until = time.monotonic() + DEADLINE
        while companion.read() != b"heard":
            assert time.monotonic() < until
        device.full, device.stuck = False, True
        while device.filled < FAR_BUFFER:
            assert time.monotonic() < until
            time.sleep(0.002)
        time.sleep(0.1)
        assert companion.write(b"the way back")
        companion.note_revocable()
        if recalled:
            companion.recall()
        device.stuck = False
        got = b""
        while b"again" not in got:
            companion.write(b"again")
            got += autopilot.recv(8192)
            assert time.monotonic() < until
        assert (b"the way back" in got) is not recalled


def non_blocking(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_NOCTTY | os.O_NONBLOCK)


def test_of_a_drum_that_appears_contacts_and_their_speeds_are_told_by_way_and_distance() -> None:
    held = Appeared(brakes=False, share=0.5, speed=1.4, needs=4.0, touched=0.5, gap=0.0)
    stood = replace(held, brakes=True, touched=0.0, gap=0.2)
    found = appearing_figures([held, replace(held, touched=0.7), stood])
    assert found["hold 0.5"] == {"runs": 2, "touched": 2, "median_m_s": 0.7, "most_m_s": 0.7}
    assert found["brake 0.5"] == {"runs": 1, "touched": 0, "median_m_s": 0.0, "most_m_s": 0.0}
