"""Lets the rules of guiding decide in each turn, and carries out what they decide."""

from __future__ import annotations

import logging
import math

from anytraverse.frame import Pose
from companion.calls.machine import OperatorCalls
from companion.config import Config
from companion.config.guiding import guide_lacks, outline, stops_in
from companion.guide.plan import Errand, Plan
from companion.guide.rules import Circumstances, Guide, GuideAnswer, GuideState, Orders
from companion.link.link import Link
from companion.vehicle import ardupilot
from companion.vehicle.motion import pose_at
from companion.vehicle.state import Vehicle
from companion.wire import notices
from companion.wire.ids import INFO, WARNING, Policy

log = logging.getLogger(__name__)


class GuideService:
    """Is asked before the state machine of calls and holds lets time pass, and tells it what it may pass.

    errand: what vision is to plan, None: nothing. Everything else that guides is `Guide`.
    """

    def __init__(self, config: Config, link: Link, calls: OperatorCalls) -> None:
        self._link = link
        self._calls = calls
        self._outline = outline(config)
        self._lacks = guide_lacks(config)
        self._speed = config.stopping.speed or 0.0
        self._corridor = config.guide.corridor
        radius = self._outline.radius if self._outline is not None else 1.0
        self._guide = Guide(radius, calls.numbers.freshness, stops_in(config))
        self.errand: Errand | None = None

    @property
    def guides(self) -> bool:
        """Whether the vehicle is driven by us, or is about to be."""
        return self._guide.guides

    def planned(self, plan: Plan, now: float) -> None:
        """Take in a plan of vision, before the frame that it belongs to is judged."""
        self._guide.planned(plan)
        self.tick(now)

    def answered(self, answer: GuideAnswer, now: float) -> None:
        """Take in an answer of the script."""
        self._guide.answered(answer, now)
        self.tick(now)

    def figures(self) -> dict[str, object]:
        """Return guiding's part of the status file."""
        return {"state": self._guide.state.value, "lacks": self._why_not() or None}

    def tick(self, now: float) -> None:
        """Decide, and hand over what is to be sent."""
        before, guide, link = self._guide.state, self._guide, self._link
        orders = guide.tick(self._circumstances(now))
        link.setpoints.target = orders.target
        if orders.request is not None:
            link.modes.guide(*orders.request, now)
        if orders.item is not None:
            link.mission.set_current(orders.item, now)
        self._calls.reason_filter.passes = guide.passes
        self._calls.reason_filter.no_way = bool(guide.stuck)
        self._calls.monitor.guided_out_of = ardupilot.AUTO if guide.guides else None
        if guide.state is not before:
            self._tell(before, guide.state, now)

    def _tell(self, before: GuideState, state: GuideState, now: float) -> None:
        log.info("guide: %s", state.value)
        texts = self._link.texts
        if state is GuideState.GUIDING and before is GuideState.TAKING:
            texts.send(notices.guiding(), INFO, now)
        elif state is GuideState.READY and before is GuideState.BACK:
            texts.send(notices.guided_back("AUTO"), INFO, now)
        elif state is GuideState.OFF and before not in (GuideState.READY, GuideState.OFF):
            texts.send(notices.guide_ended(self._guide.ended_by), WARNING, now)
