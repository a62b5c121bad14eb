"""The route of a simulated drive lies where the rover drives, by the axes of the odometry that sees it."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from companion.guide import legs
from companion.guide.route import MissionRoute
from companion.sim.field.autopilot import SimulatedAutopilot
from companion.sim.field.router import Port
from companion.sim.field.rover import Rover
from companion.sim.field.trail import Trail
from companion.sim.loopback_link import LoopbackLink

STEP = 0.02
ROUND_AND_ON = 150.0


@pytest.mark.slow
def test_a_rover_that_drives_its_mission_drives_along_the_route() -> None:
    stage, rover = LoopbackLink(vehicle=None), Rover(Trail(1))

    def told(port: Port, frame: bytes) -> bool:
        if port is Port.COMPANION:
            stage.far.write(frame)
        return True

    autopilot, obeyed = SimulatedAutopilot(rover, told), 0
    autopilot.arm(on=True)
    stage.link.mission.wanted = True
    ways = MissionRoute(3.0)
    off, turned, without, reports = 0.0, 0.0, 0, 0
    seen = None
    while rover.progress < ROUND_AND_ON:
        rover.step(STEP)
        autopilot.poll(stage.now)
        stage.run(STEP, STEP)
        for frame in stage.frames[obeyed:]:
            autopilot.receive(Port.COMPANION, frame.message)
        obeyed = len(stage.frames)
        if stage.now > 3.0 and autopilot.mode is not autopilot.mission:
            autopilot.set_mode(autopilot.mission, "hand")
        vehicle = stage.link.vehicle
        if vehicle is None or vehicle is seen:
            continue
        seen = vehicle
        route = ways.update(vehicle, stage.link.mission.items, stage.now)
        if stage.now < 4.0 or vehicle.motion is None or vehicle.motion.pose is None:
            continue
        reports += 1
        if route is None:
            without += 1
            continue
        pose = vehicle.motion.pose
        shifted = [(x - pose.x, y - pose.y) for x, y in route.points]
        off = max(off, min(legs.away(*piece) for piece in pairwise(shifted)))
        turned = max(turned, abs(math.remainder(route.at(pose)[0] - pose.heading, 360.0)))
    assert reports > 300
    assert without == 0
    assert off < 1.5, "a leg of 10 m is a chord of a bend of 12 m, 1.1 m beside its middle"
    assert turned < 30.0
