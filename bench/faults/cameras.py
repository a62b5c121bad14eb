"""Rows of cameras: absent, frozen, unplugged, black, slow."""

from __future__ import annotations

import logging
import math
import time
from dataclasses import replace
from random import Random

from bench.cameras.__main__ import T as PICTURE_OLD
from bench.cameras.__main__ import losses
from bench.faults.row import CAMERA_BACK_WITHIN, HOLD_WITHIN, Row, RowOutcome, Work
from bench.faults.stages import Produce, repeated, stops
from bench.stopping.faults import BLACK, CAMERA, SLOW, UNPLUGGED
from bench.stopping.humans import watch
from bench.stopping.jobs import Job
from bench.stopping.scenes import Seen, changed_by, follows, wait_for_mode
from bench.stopping.stage import READY_WITHIN, Plan, Stage

_NOTICED_WITHIN = PICTURE_OLD + 0.1


def _unplugged(job: Job, random: Random) -> Plan:
    return replace(job.plan(random), plugged=False)


def _absent_at_boot(stage: Stage, _random: Random) -> Seen:
    """Starts without a camera; then a person sets AUTO; then the camera is plugged in."""
    with follows():
        stage.wait("a fault", lambda: stage.read_status().get("state") == "fault", READY_WITHIN)
        said = str(stage.read_status()["camera"]["reason"]).split(" at ")[0]
        begun = time.monotonic()
        stage.control.start()
        wait_for_mode(stage, "HOLD")
        by, ordered = changed_by(stage), stage.wire.ordered(begun) or time.monotonic()
        watch(stage, 1.0)
        plugged = time.monotonic()
        stage.camera.plug(on=True)
        returned = stage.returned(plugged)
        wrong = "not well again" if returned is None else ""
        if stage.status()["mode"] != "HOLD":
            wrong = "it drove on by itself"
        return Seen(wrong, ordered - begun, returned, f"held by {by}, says: {said}")


def _lost(kind: str) -> Produce:
    def produce(work: Work) -> RowOutcome:
        logging.disable(logging.WARNING)
        figures = losses(kind, 3 if work.short else 100, work.seed)
        noticed = figures["noticed_s"].get("max", 0.0)
        wrong = [f"{figures['stale']} old pictures were taken for new ones"] * bool(figures["stale"])
        if noticed > _NOTICED_WITHIN and not (work.short and math.isfinite(noticed)):
            wrong.append(f"a loss was noticed after {noticed} s")
        saw = f"{figures['killed']} killed, {figures['frozen']} frozen; noticed within {noticed} s"
        return RowOutcome(figures["losses"], tuple(wrong), None, figures["back_s"]["max"], saw)

    return produce


ROWS = (
    Row(
        "camera absent at boot",
        "nothing listens at the camera's address; AUTO is set; then it is plugged in",
        "held as soon as it drives",
        repeated(5, _unplugged, _absent_at_boot),
        HOLD_WITHIN,
        CAMERA_BACK_WITHIN,
    ),
    Row(
        "camera frozen",
        "the same picture again and again, each as if new",
        "held",
        stops(CAMERA["frozen_camera"], 5),
        HOLD_WITHIN,
        CAMERA_BACK_WITHIN,
    ),
    Row(
        "camera frozen, with a clock in the picture",
        "the same, with another number drawn into each picture, which is compressed again",
        "held",
        stops(CAMERA["frozen_with_clock"], 5),
        HOLD_WITHIN,
        CAMERA_BACK_WITHIN,
    ),
    Row(
        "camera unplugged while driving",
        "its connection is closed and refused",
        "held",
        stops(UNPLUGGED, 5),
        HOLD_WITHIN,
        CAMERA_BACK_WITHIN,
    ),
    Row(
        "camera unplugged, a program's pipe",
        "its program is killed and cannot be started, or is stopped, for 0.2 to 3 s; 100 times",
        "noticed within T; no old picture counts",
        _lost("pipe"),
        None,
        CAMERA_BACK_WITHIN,
    ),
    Row(
        "camera unplugged, from the network",
        "its HTTP server is killed or stopped for 0.2 to 3 s; 100 times",
        "noticed within T; no old picture counts",
        _lost("http"),
        None,
        CAMERA_BACK_WITHIN,
    ),
    Row(
        "camera silent",
        "it stays connected, and sends no picture",
        "held",
        stops(CAMERA["silent_camera"], 5),
        HOLD_WITHIN,
        CAMERA_BACK_WITHIN,
    ),
    Row(
        "camera black",
        "every picture is black",
        "held, or called and held",
        stops(BLACK, 5),
        HOLD_WITHIN,
        CAMERA_BACK_WITHIN,
    ),
    Row(
        "camera slow",
        "a picture every 2.5 s, where T is 1 s",
        "held",
        stops(SLOW, 5),
        HOLD_WITHIN,
        CAMERA_BACK_WITHIN,
    ),
)
