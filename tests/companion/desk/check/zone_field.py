"""A rover that stands in the simulated field, and a person who carries a drum to where they are asked."""

from __future__ import annotations

import math
import re
import threading
import time
from collections.abc import Callable, Mapping

import cv2
import numpy as np

from companion.cameras.field import CapturedFrame
from companion.desk.check.typed_lines import TypedLines
from companion.sim.field.frame_server import FrameServer
from companion.sim.field.render import PinholeCamera
from companion.sim.field.rover import Body
from companion.sim.field.things import FieldThing, World

PERIOD = 0.05
_MARK = re.compile(r"(.+), ([\d.]+) m \((-?[\d.]+) ahead(?:, ([\d.]+) (left|right))?\):")


class StandingField:
    """Serves the pictures of a rover that stands, with a drum or without. blind: no new picture comes."""

    def __init__(self) -> None:
        self._world = World(1, ())
        self._camera = PinholeCamera(self._world)
        self._pose = self._world.trail.pose(14.0)
        self._server = FrameServer()
        self._lock = threading.Lock()
        self._ends = False
        self.blind = False
        self._thread = threading.Thread(target=self._show)
        self._thread.start()

    def close(self) -> None:
        self._ends = True
        self._thread.join()
        self._server.close()

    @property
    def source(self) -> str:
        """As [camera] source names it."""
        return f"field:127.0.0.1:{self._server.address[1]}"

    def png(self) -> bytes:
        """Return a picture."""
        with self._lock:
            picture, _ = self._camera.render(self._pose, 0.0)
        return bytes(cv2.imencode(".png", picture[..., ::-1])[1])

    def take_away(self) -> None:
        """Take the drum out of the view."""
        with self._lock:
            if "drum" in self._world.things:
                self._world.remove("drum")

    def put(self, ahead: float, right: float) -> None:
        """Put the drum down: m ahead and to the right of the middle of the rover's front."""
        pose, from_lens = self._pose, ahead + Body().radius
        c, s = np.cos(pose.heading), np.sin(pose.heading)
        x, y = pose.x + from_lens * c + right * s, pose.y + from_lens * s - right * c
        self.take_away()
        with self._lock:
            self._world.add(FieldThing("drum", "drum", float(x), float(y), 0.3, 0.9, surprise=True))

    def _show(self) -> None:
        number, began = 0, time.monotonic()
        while not self._ends:
            at = time.monotonic()
            if not self.blind:
                with self._lock:
                    picture, _ = self._camera.render(self._pose, at - began)
                number += 1
                self._server.publish(CapturedFrame(number, at, picture))
            time.sleep(max(0.005, PERIOD - (time.monotonic() - at)))


Answers = Mapping[str, list[str | BaseException]]


class Person(TypedLines):
    """Answers what is asked, and carries the drum to the marks.

    read: returns what was printed since it was asked last. answers: beginning of a question -> what is typed
    the next times, before Enter alone; an exception is raised. said: all that was printed.
    """

    def __init__(self, field: StandingField, read: Callable[[], str], answers: Answers) -> None:
        super().__init__()
        self._field, self._read = field, read
        self._answers = answers
        self.said = ""
        self.marks: list[tuple[str, float]] = []
        self._walked = 0.0

    def forget(self) -> None:
        """Nothing is typed too early."""

    def line(self, seconds: float) -> str | None:
        """Type the answer to the newest question; while it is walked, walk on."""
        if seconds == 0.0:
            return self._walk()
        self.said += self._read()
        question = self.said.rpartition("\n")[2]
        self.said += "\n"  # as a terminal shows what is typed
        if mark := _MARK.match(question):
            self.marks.append((mark[1], float(mark[2])))
            self._field.put(float(mark[3]), float(mark[4] or 0) * (-1 if mark[5] == "left" else 1))
        if question.startswith("Go out"):
            self._field.take_away()
        for begins, typed in self._answers.items():
            if question.startswith(begins) and typed:
                answer = typed.pop(0)
                if isinstance(answer, BaseException):
                    raise answer
                return answer
        return ""

    def _walk(self) -> str | None:
        """Go a step along the circle that was asked for."""
        asked = re.findall(r"a circle of ([\d.]+) m from (-?\d+)° to (-?\d+)°", self.said)[-1]
        radius, first, last = map(float, asked)
        self._walked += 0.02
        bearing = math.radians(first + self._walked * (last - first))
        self._field.put(radius * math.cos(bearing), radius * math.sin(bearing))
        return "" if self._walked >= 1.0 else None
