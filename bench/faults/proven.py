"""Rows that need root: what `make service` and `make vm` gave, from their committed results."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

from bench.faults.row import BACK_WITHIN, CAMERA_BACK_WITHIN, Row, RowOutcome, Work

RESULTS = Path(__file__).parents[1] / "results"
_LONGEST_PAUSE = 60.0
_JITTER = 1.0
"""Seconds by which a pause may be measured shorter than the one before."""

Judge = Callable[[Mapping[str, Any]], RowOutcome]


def _service(step: str, judge: Judge) -> Callable[[Work], RowOutcome]:
    return _committed("service.json", step, judge, "make vm" if step == "devices" else "make service")


def _committed(file: str, step: str, judge: Judge, by: str) -> Callable[[Work], RowOutcome]:
    def produce(_: Work) -> RowOutcome:
        held = json.loads((RESULTS / file).read_text(encoding="utf-8"))
        commits = held.get("commits", {})
        commit = commits.get(step, commits.get("all others", held.get("commit")))
        found = judge(held["figures"][step])
        return found._replace(saw=f"{found.saw}; by {by} at {commit}, {held['date']}")

    return produce


def _killed(figures: Mapping[str, Any]) -> RowOutcome:
    return RowOutcome(figures["kills"], (), None, max(figures["back_s"]), "systemd starts it again")


def _hung(figures: Mapping[str, Any]) -> RowOutcome:
    wrong = () if figures["traceback"] else ("no traceback in the journal",)
    return RowOutcome(
        1, wrong, None, figures["back_s"], "systemd's watchdog ends it, and the journal says where it hung"
    )


def _crashes(figures: Mapping[str, Any]) -> RowOutcome:
    pauses = figures["pauses_s"]
    rises = (
        all(later > one - _JITTER for one, later in pairwise(pauses))
        and _LONGEST_PAUSE <= pauses[-1] < _LONGEST_PAUSE + 2.0
    )
    wrong = () if rises else (f"pauses {pauses}",)
    saw = f"started again after {', '.join(f'{pause:.0f}' for pause in pauses)} s"
    return RowOutcome(len(pauses), wrong, None, figures["mended_back_s"], saw)


def _upgraded(figures: Mapping[str, Any]) -> RowOutcome:
    right = figures["answer"] == "applied" and figures["held_by"] == ["companion"] * 2
    saw = f"away for {figures['away_s']} s; the answer to the open call was {figures['answer']}"
    return RowOutcome(1, () if right else (str(dict(figures)),), None, figures["away_s"], saw)


def _booted(figures: Mapping[str, Any]) -> RowOutcome:
    wrong = () if figures["restarts"] == 0 else (f"{figures['restarts']} restarts",)
    saw = f"fault reported {figures['fault_reported_s']} s after the start"
    return RowOutcome(1, wrong, None, figures["sees_after_s"], saw)


def _v4l2(figures: Mapping[str, Any]) -> RowOutcome:
    wrong = () if figures["loaded"] and figures["losses"] == 10 else ("not ten losses",)
    saw = f"noticed within {figures['noticed_max_s']} s"
    return RowOutcome(figures["losses"], wrong, None, figures["back_max_s"], saw)


def _serial(figures: Mapping[str, Any]) -> RowOutcome:
    wrong = () if figures["same_process"] else ("another process",)
    saw = f"reported within {figures['loss_reported_s']} s, by the same process"
    return RowOutcome(figures["losses"], wrong, None, figures["hears_it_again_s"], saw)


def _without_devices(figures: Mapping[str, Any]) -> RowOutcome:
    right = figures["fault_without_devices"] and figures["probe"]["oak"] == ["opened"]
    saw = (
        "fault at boot; an OAK that appears may be opened. A loss of its streams needs hardware: not verified"
    )
    return RowOutcome(1, () if right else (str(dict(figures)),), saw=saw)


ROWS = (
    Row(
        "USB camera unplugged",
        "a kernel's V4L2 camera (vivid) is unbound from its driver and bound again; 10 times",
        "noticed within T",
        _committed("cameras.json", "v4l2", _v4l2, "make vm"),
        None,
        CAMERA_BACK_WITHIN,
    ),
    Row(
        "autopilot's USB cable pulled",
        "a kernel's USB serial port is pulled and plugged in again; 10 times",
        "heard again, without a restart",
        _service("devices", _serial),
        None,
        CAMERA_BACK_WITHIN,
    ),
    Row(
        "no camera, no autopilot and no OAK at boot",
        "a machine boots without devices; then they appear",
        "fault; each is used once it is there",
        _service("devices", _without_devices),
    ),
    Row(
        "service killed",
        "SIGKILL of the installed service; 3 times",
        "started again by systemd",
        _service("kill", _killed),
        None,
        BACK_WITHIN,
    ),
    Row(
        "service hangs",
        "SIGSTOP of the installed service",
        "started again by systemd",
        _service("hang", _hung),
        None,
        BACK_WITHIN,
    ),
    Row(
        "crash loop",
        "the installed service dies at each start; then it is mended",
        "started again each time",
        _service("crash_loop", _crashes),
        None,
        BACK_WITHIN,
    ),
    Row(
        "upgrade with a call open",
        "another version is installed while the rover is held",
        "call and hold stand",
        _service("upgrade", _upgraded),
        None,
        BACK_WITHIN,
    ),
    Row(
        "reboot of the computer",
        "the system with the installed service boots, without a camera at first",
        "fault, until there are pictures",
        _service("reboot", _booted),
        None,
        BACK_WITHIN,
    ),
)
