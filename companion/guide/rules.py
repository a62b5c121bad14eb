"""Decides when the companion drives the vehicle round something, and when the mission has it again. Pure.

OFF: it may not. READY: the mission drives, and a take-over would be possible. TAKING: GUIDED is requested.
GUIDING: the vehicle follows the newest plan. BACK: the mission is requested again.
A mode that was not requested here is a human's, and ends it until the mission's mode is set anew.
"""

from __future__ import annotations

import math
from collections import deque
from enum import Enum
from typing import NamedTuple

from anytraverse.frame import Pose
from companion.guide.motion import SPARE, STAND, STOPS_IN, Target, follow
from companion.guide.plan import Plan
from companion.vehicle.ardupilot import AUTO, GUIDED

PLANS = 3
"""Plans in a row that must be clear before it takes over."""
MODE_AGE, MOTION_AGE = 1.5, 0.3
"""s: the oldest mode, attitude and position by which it takes over."""
TAKEN_WITHIN = 0.5
"""s after which a take-over that does not show has failed."""
MOTION_LOST = 0.7
"""s without an attitude or position after which guiding ends."""
STUCK_AFTER = 0.5
"""s without a way after which the vehicle is stopped for good. It slows down at once."""
CLEAR_FOR = 2.0
"""s for which the mission's way must be clear before the mission has the vehicle again."""
NEARS, NEARS_FOR = 2.0, 5.0
"""m before a waypoint that may be passed, where the mission does not get the vehicle back, and s for which.
ArduPilot would slow down for one that is near and aside, or turn round to one that it has just passed."""
ALONG = 20.0
"""Degrees by which the heading may differ from the leg's then."""
NO_WAY = "no way round"
"""Why it stops where nothing is wrong with itself."""
_AMBLES = 0.5
"""m/s at which a vehicle that stands in a hold drives as it is taken over."""
_NEAR = 1.0
"""m before the vehicle within which something that leaves no way keeps it in a hold, seen or not."""
_FARTHER = 1.0
"""m beyond the way to a standstill over which a plan should be clear, so that a detour begins in time."""
_WORTH = 4.0
"""m of the way beyond a standstill that must be left for a take-over."""
_SHOWS_WITHIN = 2.5
"""s within which the mission's mode may show that was requested: a heartbeat may be lost."""
_EASES = 0.05
"""m/s2 by which what the mission was seen to drive counts for less, as it may have become slower."""
_AGAIN, _TRIES = 0.5, 6
"""s from one request to give the vehicle back, or order of an item, to the next; how many there are."""
_ASKED = 1.0
"""s from one question to the script whether GUIDED is still ours to the next."""
_ABANDONED, _SLOWS = 5.0, 0.3
"""s after which guiding that is not allowed any more has ended; s for which it asks to stand first."""


class GuideState(str, Enum):
    """See the module."""

    OFF = "off"
    READY = "ready"
    TAKING = "taking"
    GUIDING = "guiding"
    BACK = "back"


class Circumstances(NamedTuple):
    """What it decides by. Times are monotonic s.

    allowed: the policy is guide, and nothing that it needs is missing. mode, mode_at, armed: as reported
    last; mode_at is None where they count no more. motion_at, position_at: of the newest reports; -inf for
    none. pose: where the vehicle is now, None: not known. driven, speed: m/s that it drives, and may drive at
    most. held: our hold is commanded or stands. stopped: the script's does. asks: something that cannot be
    passed stops the vehicle. shows: something in the region of interest would stop it that may have room
    beside it. accepts: an operator has accepted something there.
    item, passed: numbers of the mission's current item, and of the one that it should be by where the vehicle
    is. leg: direction of the mission's way in degrees counter-clockwise; None where it is not known. left: m
    of it that may be driven without the mission's mode. nears: m to the waypoint of `passed`, inf where that
    may not be passed.
    """

    now: float
    allowed: bool
    mode: int | None
    mode_at: float | None
    armed: bool
    motion_at: float
    position_at: float
    pose: Pose | None
    driven: float
    speed: float
    held: bool
    stopped: bool
    asks: bool
    shows: bool
    accepts: bool
    item: int
    passed: int
    leg: float | None
    left: float
    nears: float


class Orders(NamedTuple):
    """What to do now. target: to stream, None: nothing. request: mode to set, and the one that must stand.

    item: to make the mission's current one first.
    """

    target: Target | None = None
    request: tuple[int, int] | None = None
    item: int | None = None


class GuideAnswer(NamedTuple):
    """What the script on the autopilot answers to a request for a mode.

    done: the mode is set and ours; None: somebody else has the vehicle; False: refused.
    """

    mode: int
    done: bool | None


class Guide:
    """The state, and the newest plans.

    passes: what shows in the region of interest is driven round, or will be, and stops nobody.
    stuck: why the vehicle must be stopped although only this shows it; "" where it need not.
    ended_by: why it ended last, for a person.
    """

    def __init__(self, radius: float, freshness: float, stops_in: float = STOPS_IN) -> None:
        """radius: of the tightest turn, m. freshness: s after which a plan is too old.

        stops_in: s; multiplied by the speed it gives the way to a standstill.
        """
        self._radius, self._freshness = radius, freshness
        self._stops_in = max(STOPS_IN, stops_in)
        self._plans: deque[Plan] = deque(maxlen=PLANS)
        self._since = self._requested_at = self._shown_at = self._asked_at = self._tried_at = -math.inf
        self._tries = 0
        self._back_asked_at = -math.inf
        """When the mission's mode was requested last."""
        self._given_back_at: float | None = None
        """When the script has set the mission's mode again, while the report of that is to come."""
        self._cruise, self._cruise_at = 0.0, -math.inf
        """What the mission drives, m/s, and when that was seen."""
        self._not_allowed_since: float | None = None
        self._stands_since: float | None = None
        self._clear_since: float | None = None
        self._ended_at = -math.inf
        self._refused_in_mission = False
        """A human has ended it with the mission's mode. It waits until another mode was set."""
        self.state = GuideState.OFF
        self.passes = False
        self.stuck = ""
        self.ended_by = ""

    @property
    def guides(self) -> bool:
        """Whether the vehicle's mode is ours, or is about to be."""
        return self.state in (GuideState.TAKING, GuideState.GUIDING, GuideState.BACK)

    def far(self, speed: float) -> float:
        """Return the m over which a way should be clear at this speed, m/s: to a standstill, and more."""
        return self._stops_in * speed + SPARE + _FARTHER

    def planned(self, plan: Plan) -> None:
        """Take in a plan. One that is older than the newest is ignored."""
        if self._plans and plan.at <= self._plans[-1].at:
            return
        self._plans.append(plan)

    def answered(self, answer: GuideAnswer, now: float) -> None:
        """Take in the script's answer."""
        mode, done = answer
        if not self.guides or self._given_back_at is not None:
            return
        if done is None:
            self._end("by hand", now, refused=True)
        elif not done and self.state is GuideState.TAKING:
            self.stuck = "no take-over"
        elif not done and self.state is GuideState.GUIDING and mode == GUIDED:
            self._end("by hand", now, refused=True)  # its word that it guides no more was lost
        elif done == (mode == GUIDED) and self.state is not GuideState.TAKING:
            self._back_asked_at = -math.inf  # the mission's mode was not set
        elif done and mode == AUTO and self.state is not GuideState.TAKING:
            self._given_back_at = now
        elif done and mode == GUIDED and self.state is GuideState.TAKING:
            self._enter(GuideState.GUIDING, now)

    def tick(self, c: Circumstances) -> Orders:
        """Decide."""
        if c.mode != AUTO and c.mode_at is not None and c.mode_at > self._ended_at:
            self._refused_in_mission = False
        self._note_cruise(c)
        orders = self._follow_mode(c) or self._drive(c) if self.guides else self._wait(c)
        self.passes = self._passes(c)
        return orders

    def _wait(self, c: Circumstances) -> Orders:
        ready = (
            c.allowed and c.armed and c.mode == AUTO and c.leg is not None and not self._refused_in_mission
        )
        if not ready or c.held:
            self.state = GuideState.OFF
            shut = c.held and c.allowed and not c.accepts and self._is_shut(c.now)
            self.stuck = NO_WAY if shut else ""
            # AUTO would turn round to a waypoint that was passed, if only while the hold braked.
            stands = (c.held and c.mode != AUTO) or c.stopped
            behind = stands and c.allowed and c.passed > c.item
            if not behind:
                self._tries, self._tried_at = 0, -math.inf
            return Orders(item=c.passed) if behind and self._tries_again(c) else Orders()
        self.state, self.stuck = GuideState.READY, ""
        # In two plans, since a cell of the grid may be wrong for once.
        blocked = len(self._plans) == PLANS and all(plan.route_blocked for plan in list(self._plans)[-2:])
        if ((blocked and not c.accepts) or c.shows) and not c.asks and self._may_take(c):
            self._enter(GuideState.TAKING, c.now)
            self._requested_at = math.inf
            return Orders(self._target(c))
        return Orders()

    def _may_take(self, c: Circumstances) -> bool:
        known = c.mode_at is not None and c.now - c.mode_at < MODE_AGE
        fresh = self._knows_motion(c)
        lasts = c.left > self._stops_in * c.driven + _WORTH
        return known and fresh and lasts and self._plans_clear(c.driven, c.now)

    def _plans_clear(self, driven: float, now: float) -> bool:
        """Whether the last plans are clear over the way to a standstill, and none of them is old."""
        if len(self._plans) < PLANS or now - self._plans[-1].at > self._freshness:
            return False
        needed = self._stops_in * driven + SPARE
        in_a_row = all(
            after.at - before.at <= self._freshness
            for before, after in zip(self._plans, list(self._plans)[1:], strict=False)
        )
        return in_a_row and all(plan.arcs and plan.clear >= needed for plan in self._plans)

    def _is_shut(self, now: float) -> bool:
        """Whether something is known to stand right before the vehicle, maybe below the picture or beside it.

        A way round it counts where a take-over would be possible at once: until then the mission drives.
        """
        newest = self._plans[-1] if self._plans else None
        if newest is None or now - newest.at > self._freshness:
            return False
        return newest.route_blocked and newest.route_clear < _NEAR and not self._plans_clear(_AMBLES, now)

    def _passes(self, c: Circumstances) -> bool:
        if self.stuck or not c.allowed:
            return False
        asked = c.now - self._back_asked_at <= _SHOWS_WITHIN or self._given_back_at is not None
        if self.guides and not asked:
            return True
        if self.guides or self.state is GuideState.READY:  # AUTO drives, or may do so already
            return self._may_take(c)
        # In our hold: it may be resumed where a take-over will be possible.
        lasts, fresh = c.left > self._stops_in * _AMBLES + _WORTH, self._knows_motion(c)
        return c.held and c.leg is not None and lasts and fresh and self._plans_clear(_AMBLES, c.now)

    @staticmethod
    def _knows_motion(c: Circumstances) -> bool:
        return c.pose is not None and c.now - min(c.motion_at, c.position_at) < MOTION_AGE

    def _follow_mode(self, c: Circumstances) -> Orders | None:
        """Follow the reported mode. Returns orders where it has ended."""
        ours = (AUTO, GUIDED) if self.state is GuideState.TAKING else (GUIDED,)
        if c.held:
            # The hold brakes without a target. Nothing is streamed any more, whoever has the vehicle then.
            self._end("held", c.now, refused=False)
            return Orders()
        if c.armed and (c.mode_at is None or c.mode_at <= self._since):
            return None  # it was reported before this state began
        mode_at = -math.inf if c.mode_at is None else c.mode_at
        if c.mode == AUTO and c.armed and mode_at - self._back_asked_at <= _SHOWS_WITHIN:
            self._enter(GuideState.READY, c.now)
            return Orders()
        back = self._given_back_at is not None and mode_at >= self._given_back_at
        if c.mode not in ours or back or not c.armed or (c.mode == GUIDED and self._requested_at == math.inf):
            self._end("by hand", c.now, refused=True)
            return Orders()
        return None

    def _drive(self, c: Circumstances) -> Orders:
        if self._given_back_at is not None:
            return Orders()  # a target could reach a GUIDED that somebody else sets now
        if not c.allowed:
            return self._abandon(c)
        self._not_allowed_since = None
        if self.state is GuideState.TAKING and c.now - self._requested_at > TAKEN_WITHIN:
            self.stuck = self.stuck or "no take-over"
        elif c.mode_at is None or c.now - min(c.motion_at, c.position_at) > MOTION_LOST:
            self.stuck = self.stuck or "motion lost"
        if self.stuck or c.asks:  # it is held for that. Where it cannot be, the script stops it
            self._stands_since = self._stands_since or c.now
            return Orders(STAND) if c.now - self._stands_since <= _SLOWS else Orders()
        self._stands_since = None
        target = self._target(c)
        if self.state is GuideState.TAKING:
            return self._take(c, target)
        self._note_way(c, target)
        if self.state is GuideState.BACK:
            return self._give_back(c, target)
        if self._may_give_back(c):
            self._enter(GuideState.BACK, c.now)
        elif c.now - self._asked_at >= _ASKED:
            # Whoever takes over without a change of mode shows only to the script.
            self._asked_at = c.now
            return Orders(target, request=(GUIDED, GUIDED))
        return Orders(target)

    def _take(self, c: Circumstances, target: Target) -> Orders:
        # The heartbeat that says so leaves with the turn before.
        if self._requested_at < math.inf or c.now <= self._since:
            return Orders(target)
        self._requested_at = c.now
        return Orders(target, request=(GUIDED, AUTO))

    def _abandon(self, c: Circumstances) -> Orders:
        """End guiding that is not allowed any more: without targets the script stops the vehicle."""
        since = self._not_allowed_since = self._not_allowed_since or c.now
        self.stuck = self.stuck or "not allowed"
        if c.mode == AUTO or c.now - since > _ABANDONED:
            self._end("not allowed", c.now, refused=False)
            return Orders()
        return Orders(STAND) if c.now - since <= _SLOWS else Orders()

    def _target(self, c: Circumstances) -> Target:
        newest = self._plans[-1] if self._plans else None
        if newest is None or not newest.arcs or c.pose is None or c.now - newest.at > self._freshness:
            return STAND
        # What the mission does at the end of this way only its own mode can do.
        newest = newest._replace(clear=min(newest.clear, c.left))
        speed = min(c.speed, max(self._cruise, _AMBLES))
        return follow(newest, c.pose, speed, self._stops_in, self._radius)

    def _note_cruise(self, c: Circumstances) -> None:
        """Note how fast the mission drives: GUIDED drives no faster."""
        if self.state is GuideState.READY:
            eased = self._cruise - _EASES * max(0.0, c.now - self._cruise_at)
            self._cruise = max(c.driven, eased)
        self._cruise_at = c.now

    def _note_way(self, c: Circumstances, target: Target) -> None:
        """Note since when there is no way."""
        if target.speed > 0.0:
            self._shown_at = c.now
        elif c.now - max(self._shown_at, self._since) > STUCK_AFTER:
            self.stuck = NO_WAY

    def _may_give_back(self, c: Circumstances) -> bool:
        newest = self._plans[-1]
        if c.now - newest.at > self._freshness:
            return False
        clear = not newest.route_blocked and newest.route_clear >= self._stops_in * c.driven + SPARE
        along = (
            c.leg is not None
            and c.pose is not None
            and abs(math.remainder(c.pose.heading - c.leg, 360.0)) <= ALONG
        )
        if not clear or not along or c.shows:
            self._clear_since = None
            return False
        self._clear_since = c.now if self._clear_since is None else self._clear_since
        ends = c.left < self._stops_in * c.driven + 2.0 * SPARE
        waits = CLEAR_FOR + (NEARS_FOR if c.nears < NEARS else 0.0)
        return c.now - self._clear_since >= (0.0 if ends else waits)

    def _give_back(self, c: Circumstances, target: Target) -> Orders:
        if self._plans[-1].route_blocked or c.shows:
            self._enter(GuideState.GUIDING, c.now)
            return Orders(target)
        if self._tries == _TRIES and c.now - self._tried_at >= _AGAIN:
            self.stuck = "AUTO refused"
            return Orders(STAND)
        if not self._tries_again(c):
            return Orders(target)
        if c.item != c.passed:
            return Orders(target, item=c.passed)
        self._back_asked_at = c.now
        return Orders(target, request=(AUTO, GUIDED))

    def _tries_again(self, c: Circumstances) -> bool:
        """Whether one of the tries is due, and count it."""
        if self._tries == _TRIES or c.now - self._tried_at < _AGAIN:
            return False
        self._tries, self._tried_at = self._tries + 1, c.now
        return True

    def _enter(self, state: GuideState, now: float) -> None:
        self.state, self._since, self._shown_at = state, now, now
        if state in (GuideState.READY, GuideState.TAKING):
            self._back_asked_at = -math.inf
        self._requested_at, self._tries, self._tried_at = -math.inf, 0, -math.inf
        self._clear_since = None
        self._asked_at, self._given_back_at = now, None
        self._not_allowed_since = self._stands_since = None

    def _end(self, why: str, now: float, *, refused: bool) -> None:
        self.state, self.stuck, self.ended_by, self._ended_at = GuideState.OFF, "", why, now
        self._given_back_at = self._not_allowed_since = self._stands_since = None
        self._tries, self._tried_at, self._back_asked_at = 0, -math.inf, -math.inf
        self._refused_in_mission = refused
