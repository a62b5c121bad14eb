"""Real processes on the simulated trail, a run of each kind: what happened, not how quickly.

How quickly is judged by `make bench-stopping`, on a machine that does nothing else.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from bench.stopping.figures import figures, good
from bench.stopping.limits import SPARE, Limit, braking, script_timeout
from bench.stopping.runs import FAST, GROUPS, LATE, Job, Run, untested
from bench.stopping.stops import Stop, stopped
from companion.config import load_config
from companion.config.stopping import Stopping, judge_stopping
from companion.sim.demo.config import write_config
from companion.wire.ids import Policy, State

pytest.importorskip("lupa.lua53", reason="the script on the autopilot runs in Lua 5.3")

SEEDS = (1,)
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
        jobs = [(group, Job(seed, out / name, cancelled)) for seed in SEEDS for name, group in GROUPS.items()]
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
            tmp_path, camera="field:h:1", link="udpout:127.0.0.1:9", policy="hold", speed=FAST
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
