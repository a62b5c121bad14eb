"""Simulates the rover: a body with mass that follows the trail and, like a real one, does not stop at once.

It is a kinematic bicycle with force-limited longitudinal dynamics. Along the trail it steers by pure pursuit
(Coulter, "Implementation of the Pure Pursuit Path Tracking Algorithm", CMU-RI-TR-92-01, 1992).
Lengths in m, angles in rad (counter-clockwise, 0 along x), times in s, forces in N.
"""

from __future__ import annotations

import enum
import math
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from companion.sim.field.motion import Attitude, RoverMotion

if TYPE_CHECKING:
    from companion.sim.field.trail import Trail, TrailPose


STEP = 0.02
STANDSTILL = 0.02  # m/s below which it counts as standing
OVERRUN = 2.5  # m that it drives on in LOITER before it turns back; measured on PX4's own simulation
RETURN_SPEED = 1.0  # m/s
ARRIVED = 0.5  # m from a point within which it has arrived


class MotorDrive(enum.Enum):
    """What the autopilot makes the motors do."""

    FOLLOW = "follow"  # along the trail at cruise speed; backwards, the way it came, if `Rover.reversed`
    HOLD = "hold"  # to standstill as ArduPilot's HOLD does it, and stay
    TARGET = "target"  # with the speed and the rate of turning that `Rover.target` says
    STOP = "stop"  # to standstill as ArduPilot's GUIDED without a target does it, and stay
    BRAKE = "brake"  # to standstill as hard as it can, and stay
    CIRCLE = "circle"  # run on, then drive back to where this began, and stay
    HOME = "home"  # straight to the start of the trail, and stay
    HAND = "hand"  # as the pilot's throttle and steering say
    OFF = "off"  # motors off: coast


@dataclass(frozen=True)
class Body:
    """The rover's body. It accelerates at 1 m/s2 by default.

    `MotorDrive.BRAKE` stops it from 2.5 m/s in 2.6 m by default. `MotorDrive.HOLD` decelerates by
    `easing` x speed + `easing_rest`. Its stopping distances are within 2 % of those of ArduPilot Rover
    4.7-dev in its own simulation (companion.vehicle.brakes.ARDUPILOT). `MotorDrive.STOP` does so by
    `stopping` x speed + `stopping_rest`, 16 % shorter to 3 % longer than its GUIDED (docs/stopping.md).
    """

    mass: float = 80.0  # kg
    drive_force: float = 112.0
    brake_force: float = 80.0
    rolling_force: float = 32.0
    easing: float = 0.5  # 1/s
    easing_rest: float = 0.035  # m/s2
    stopping: float = 0.34  # 1/s
    stopping_rest: float = 0.42  # m/s2
    top_speed: float = 5.0
    wheelbase: float = 0.6
    max_steering: float = 0.6
    steering_rate: float = 1.5
    reaction: float = 0.15
    radius: float = 0.6


@dataclass
class Transmitter:
    """The pilot's transmitter: throttle, steering (left positive) in [-1, 1], switches (channel -> us).

    on: whether the receiver hears it; otherwise no channel is told.
    """

    throttle: float = 0.0
    steering: float = 0.0
    switches: dict[int, int] = field(default_factory=dict)
    on: bool = True


@dataclass(frozen=True)
class Order:
    """One command to the actuators; it acts `Body.reaction` s after it was given."""

    force: float = 0.0
    brake: bool = False
    ease: bool = False
    stop: bool = False
    steering: float | None = None  # None: leave the wheels as they are


class Rover:
    """The state of the body in virtual time; only `step` moves it."""

    def __init__(
        self,
        trail: Trail,
        *,
        cruise_speed: float = 2.5,
        body: Body | None = None,
        motion: RoverMotion | None = None,
    ) -> None:
        self.body = body or Body()
        self._motion = motion or RoverMotion(trail)
        self.cruise_speed = cruise_speed
        self.reversed = False
        self.target: tuple[float, float] | None = None  # m/s, rad/s counter-clockwise
        self._drive = MotorDrive.OFF
        self._circled_from: tuple[float, float] | None = None
        self._ran_on = False
        self.transmitter = Transmitter()
        self._trail = trail
        start = trail.pose(trail.start)
        self.x, self.y, self.heading = start.x, start.y, start.heading
        self.speed = 0.0
        self.s = trail.start
        self.distance = 0.0
        self.standstill = 0.0
        self.time = self.booted_at = 0.0
        self._progress = 0.0
        self._wheels = 0.0
        self._rejoining = False
        self._unstepped = 0.0
        delay = max(0, round(self.body.reaction / STEP))
        self._orders: deque[Order] = deque([Order()] * delay)

    @property
    def pose(self) -> TrailPose:
        from companion.sim.field.trail import TrailPose

        return TrailPose(self.x, self.y, self.heading)

    @property
    def attitude(self) -> Attitude:
        bearing = self.heading - self._trail.pose(self.s).heading
        return self._motion.at(self.time, self.s, self.speed, bearing)

    @property
    def drive(self) -> MotorDrive:
        """What the motors are to do now."""
        return self._drive

    @drive.setter
    def drive(self, drive: MotorDrive) -> None:
        if drive is not self._drive:
            self._circled_from, self._ran_on = (self.x, self.y), self.speed < STANDSTILL
        self._drive = drive

    @property
    def laps(self) -> int:
        """Number of whole rounds of the trail driven so far, never negative."""
        return max(0, int(self._progress // self._trail.length))

    @property
    def lap(self) -> float:
        """Metres of a round of the trail."""
        return self._trail.length

    @property
    def progress(self) -> float:
        """Metres along the trail since the mission began; negative behind its start."""
        return self._progress

    def place(self, progress: float) -> tuple[float, float]:
        """Returns where the trail is so many metres after its start: x and y in m."""
        pose = self._trail.pose(self._trail.start + progress)
        return pose.x, pose.y

    def restart_mission(self) -> None:
        """Drives straight to the start of the trail, then along it from there; the laps count from 0."""
        self._rejoining = True
        self._progress = 0.0

    def step(self, dt: float) -> None:
        """Lets `dt` s pass in substeps of `STEP`; a remainder counts for the next call."""
        self._unstepped += dt
        while self._unstepped >= STEP - 1e-9:
            self._unstepped -= STEP
            self._substep()

    def _substep(self) -> None:
        self._orders.append(self._order())
        order = self._orders.popleft()
        self._accelerate(order)
        if order.steering is not None:
            turn = self.body.steering_rate * STEP
            wanted = _clamp(order.steering, self.body.max_steering)
            self._wheels += _clamp(wanted - self._wheels, turn)
        self.heading = _wrapped(
            self.heading + self.speed * math.tan(self._wheels) / self.body.wheelbase * STEP
        )
        self.x += self.speed * math.cos(self.heading) * STEP
        self.y += self.speed * math.sin(self.heading) * STEP
        self._update_totals()

    def _accelerate(self, order: Order) -> None:
        body = self.body
        speed = self.speed + order.force / body.mass * STEP
        slower = (body.rolling_force + (body.brake_force if order.brake else 0.0)) / body.mass
        if order.ease:  # the motors drive against the rolling friction, so that it is no harsher
            slower = body.easing * abs(speed) + body.easing_rest
        if order.stop:
            slower = body.stopping * abs(speed) + body.stopping_rest
        self.speed = math.copysign(max(0.0, abs(speed) - slower * STEP), speed)

    def _update_totals(self) -> None:
        self.time += STEP
        self.distance += abs(self.speed) * STEP
        if abs(self.speed) < STANDSTILL:
            self.standstill += STEP
        s, _ = self._trail.nearest(self.x, self.y)
        length = self._trail.length
        moved = (s - self.s + length / 2) % length - length / 2
        self.s = s
        if not self._rejoining:
            self._progress += moved

    def _order(self) -> Order:
        if self.drive is MotorDrive.FOLLOW and self.reversed:
            return Order(force=self._force_for(-self.cruise_speed), steering=self._backwards())
        if self.drive is MotorDrive.FOLLOW:
            return Order(force=self._force_for(self.cruise_speed), steering=self._pursuit())
        if self.drive is MotorDrive.HOLD:
            return Order(ease=True)
        if self.drive is MotorDrive.STOP:
            return Order(stop=True)
        if self.drive is MotorDrive.BRAKE:
            return Order(brake=True)
        if self.drive is MotorDrive.TARGET:
            return self._as_targeted()
        if self.drive is MotorDrive.CIRCLE:
            return self._circle()
        if self.drive is MotorDrive.HOME:
            home = self._trail.pose(self._trail.start)
            return self._towards(home.x, home.y, self.cruise_speed)
        if self.drive is MotorDrive.HAND:
            hand, body = self.transmitter, self.body
            spent = hand.throttle * self.speed > 0 and abs(self.speed) >= body.top_speed
            force = 0.0 if spent else hand.throttle * body.drive_force
            return Order(force=force, steering=hand.steering * body.max_steering)
        return Order()

    def _as_targeted(self) -> Order:
        """Follows the wanted arc until it has the wanted speed: it never turns more sharply."""
        speed, turn = self.target or (0.0, 0.0)
        wanted = _clamp(speed, self.cruise_speed)
        along = math.copysign(max(abs(self.speed), abs(wanted), STANDSTILL), wanted)
        steering = math.atan(self.body.wheelbase * turn / along)
        return Order(force=self._force_for(wanted), steering=_clamp(steering, self.body.max_steering))

    def _circle(self) -> Order:
        """Loiters like a rover with car steering: it cannot turn on the spot and overruns the point first."""
        x, y = self._circled_from or (self.x, self.y)
        if not self._ran_on:
            self._ran_on = math.hypot(x - self.x, y - self.y) >= OVERRUN
            return Order(force=self._force_for(max(RETURN_SPEED, self.speed - 1.0)), steering=0.0)
        return self._towards(x, y, RETURN_SPEED)

    def _towards(self, x: float, y: float, speed: float) -> Order:
        """Drives to a point and brakes there; once it has arrived it does not drive off again."""
        if math.hypot(x - self.x, y - self.y) < ARRIVED:
            self._circled_from = self.x, self.y
            return Order(brake=True)
        slowly = min(speed, max(ARRIVED, math.hypot(x - self.x, y - self.y)))
        return Order(force=self._force_for(slowly), steering=self._steering_to(x, y, 2.4))

    def _force_for(self, wanted: float) -> float:
        body = self.body
        hold_speed = math.copysign(body.rolling_force, wanted) if wanted else 0.0
        force = 2.0 * body.mass * (wanted - self.speed) + hold_speed
        backwards = body.drive_force if wanted < 0 else body.brake_force
        return min(body.drive_force, max(-backwards, force))

    def _pursuit(self) -> float:
        ahead = 1.2 + 0.4 * abs(self.speed)
        goal = self._trail.pose((self.s + ahead) % self._trail.length)
        if self._rejoining:
            goal = self._trail.pose(self._trail.start)
            if math.hypot(goal.x - self.x, goal.y - self.y) < ahead:
                self._rejoining = False
        return self._steering_to(goal.x, goal.y, 2.0 * ahead)

    def _backwards(self) -> float:
        """Steers the rear along the trail: behind the rover it is what the nose is in front."""
        behind = 1.2 + 0.4 * abs(self.speed)
        goal = self._trail.pose((self.s - behind) % self._trail.length)
        return -self._steering_to(goal.x, goal.y, 2.0 * behind, rear=True)

    def _steering_to(self, x: float, y: float, longest: float, *, rear: bool = False) -> float:
        leads = self.heading + math.pi * rear
        bearing = _wrapped(math.atan2(y - self.y, x - self.x) - leads)
        reach = max(0.5, math.hypot(x - self.x, y - self.y))
        # A goal behind the rover has no arc in front of it: turn as hard as the wheels allow.
        bearing = _clamp(bearing, math.pi / 2)
        return math.atan2(2.0 * self.body.wheelbase * math.sin(bearing), min(reach, longest))


def _clamp(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))


def _wrapped(angle: float) -> float:
    return math.remainder(angle, math.tau)
