"""Lets the rules of guiding decide in each turn, and carries out what they decide."""

from __future__ import annotations

import logging
import math

from companion.calls.machine import OperatorCalls
from companion.calls.reason_filter import PASSABLE
from companion.config import Config
from companion.config.guiding import guide_lacks, outline, stops_in
from companion.guide.motion import ASIDE
from companion.guide.plan import Errand, Plan
from companion.guide.route import MissionRoute
from companion.guide.rules import Circumstances, Guide, GuideAnswer, GuideState
from companion.link.link import Link
from companion.vehicle import ardupilot
from companion.vehicle.motion import pose_at
from companion.wire import notices
from companion.wire.ids import INFO, WARNING, Policy

log = logging.getLogger(__name__)

_RADII = 0.25
"""m from one radius of a turn that is planned with to the next."""


class GuideService:
    """Is asked before the state machine of calls and holds lets time pass, and tells it what it may pass.

    errand: what vision is to plan, None: nothing. lacks: of `guide_lacks`. All else is `Guide`.
    """

    def __init__(self, config: Config, link: Link, calls: OperatorCalls) -> None:
        self._link = link
        self._calls = calls
        self._outline = outline(config)
        self.lacks = guide_lacks(config)
        self._speed = config.stopping.speed or 0.0
        self._mission = MissionRoute(config.guide.corridor)
        radius = self._outline.radius if self._outline is not None else 1.0
        self._guide = Guide(radius, calls.numbers.freshness, stops_in(config))
        self.errand: Errand | None = None
        self._told = GuideState.OFF

    @property
    def guides(self) -> bool:
        """Whether the vehicle is driven by us, or is about to be."""
        return self._guide.guides

    def planned(self, plan: Plan, now: float) -> None:
        """Take in a plan of vision. It comes after the frame that it belongs to."""
        self._guide.planned(plan)
        self.tick(now)

    def answered(self, answer: GuideAnswer, now: float) -> None:
        """Take in an answer of the script."""
        self._guide.answered(answer, now)
        self.tick(now)

    def figures(self) -> dict[str, object]:
        """Return guiding's part of the status file."""
        return {"state": self._guide.state.value, "lacks": self._why_not() or self._mission.why or None}

    def tick(self, now: float) -> None:
        """Decide, and hand over what is to be sent."""
        guide, link = self._guide, self._link
        in_force = self._calls.policy is Policy.GUIDE and not self.lacks
        link.mission.wanted = in_force
        link.request_quick_motion(quick=in_force)
        orders = guide.tick(self._circumstances(now))
        link.setpoints.target = orders.target
        if orders.request is not None:
            link.modes.guide(*orders.request, now)
        if orders.item is not None:
            link.set_current_item(orders.item, now)
        self._calls.reason_filter.passes = guide.passes
        self._calls.reason_filter.no_way = guide.stuck if self._calls.policy.holds else ""
        self._calls.monitor.guided_out_of = ardupilot.AUTO if guide.guides else None
        if guide.state is not self._told:
            before, self._told = self._told, guide.state
            self._tell(before, guide.state, now)

    def _circumstances(self, now: float) -> Circumstances:
        vehicle, calls = self._link.vehicle, self._calls
        report, motion = calls.monitor.newest, vehicle.motion if vehicle is not None else None
        pose = None if motion is None else pose_at([motion], now)
        allowed, outline = not self._why_not(), self._outline
        route = self._mission.update(vehicle, self._link.mission.items, now) if allowed else None
        told = (None, 0.0) if route is None or pose is None else route.at(pose)
        driven = abs(motion.speed) if motion is not None else 0.0
        self.errand = None
        if route is not None and outline is not None:
            # At this speed it turns no tighter. In steps, since each radius has its own tree.
            turns = math.ceil(driven * driven / ASIDE / _RADII) * _RADII
            shape = outline._replace(radius=max(outline.radius, turns))
            self.errand = Errand(route, shape, self._guide.far(self._speed))
        item = report.mission.item if report.mission is not None else 0
        known = calls.monitor.known(now) and not calls.monitor.heartbeat_lost(now)
        position_at = vehicle.position_at if vehicle is not None else None
        return Circumstances(
            now=now,
            allowed=allowed,
            mode=report.mode,
            mode_at=report.reported_at if known else None,
            armed=report.armed,
            motion_at=-math.inf if motion is None else motion.at,
            position_at=-math.inf if position_at is None else position_at,
            pose=pose,
            driven=driven,
            speed=self._speed,
            held=calls.hold is not None,
            stopped=calls.holding.script_holds is not None,
            asks=bool(calls.reasons(now) - PASSABLE),
            shows=calls.reason_filter.shows_passable,
            accepts=bool(calls.reason_filter.things.accepted & PASSABLE),
            item=item,
            passed=item if route is None else self._mission.item,
            leg=told[0],
            left=told[1],
            nears=self._mission.nears,
        )

    def _why_not(self) -> str:
        """Say what guiding lacks now, "" for nothing."""
        if self._calls.policy is not Policy.GUIDE:
            return "policy is not guide"
        if self.lacks:
            return f"set {self.lacks}"
        if self._calls.monitor.newest.autopilot is not ardupilot.ROVER:
            return "no ArduPilot rover"
        return "" if self._link.modes.compares else "the script on the autopilot is not heard"

    def _tell(self, before: GuideState, state: GuideState, now: float) -> None:
        log.info("guide: %s", state.value)
        texts = self._link.texts
        if state is GuideState.GUIDING and before is GuideState.TAKING:
            texts.send(notices.guiding(), INFO, now)
        elif state is GuideState.READY and before is GuideState.BACK:
            texts.send(notices.guided_back("AUTO"), INFO, now)
        elif state is GuideState.OFF and before not in (GuideState.READY, GuideState.OFF):
            texts.send(notices.guide_ended(self._guide.ended_by), WARNING, now)
