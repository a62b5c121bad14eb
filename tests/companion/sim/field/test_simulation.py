"""World, rover and autopilot together, in virtual time, as the onlooker's requests see them."""

from __future__ import annotations

import contextlib
import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.regions import Box
from companion.sim.field.control import FieldError
from companion.sim.field.modes import Mode
from companion.sim.field.requests import ControlRequests
from companion.sim.field.router import Port
from companion.sim.field.simulation import LONGEST_GAP, Simulation
from companion.sim.field.things import World


class Scene:
    def __init__(self, seed: int = 1) -> None:
        self.world = World(seed)
        self.simulation = Simulation(self.world, self._nobody)
        self.frozen: bool | None = None
        self.filmed: list[float] = []
        self.stopped = False
        self.looked: list[tuple[Box, float | None]] = []
        self.requests = ControlRequests(
            self.simulation,
            status=self.simulation.status,
            look=self._look,
            freeze=self._freeze,
            film=self.filmed.append,
            stop=self._stop,
        )

    @staticmethod
    def _nobody(_port: Port, _frame: bytes) -> bool:
        return False

    def _look(self, box: Box, at: float | None) -> dict[str, Any]:
        self.looked.append((box, at))
        return {"kind": "drum"}

    def _freeze(self, on: bool) -> None:
        self.frozen = on

    def _stop(self) -> None:
        self.stopped = True

    def ask(self, do: str, **fields: Any) -> dict[str, Any]:
        return self.requests.handle({"do": do, **fields})

    def pass_time(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.1)):
            self.simulation.advance(0.1)

    def contacts(self) -> list[str]:
        return [str(contact["id"]) for contact in self.ask("status")["contacts"]]


@pytest.fixture
def scene() -> Scene:
    return Scene()


def surprises_ahead(scene: Scene) -> list[dict[str, Any]]:
    return [thing for thing in scene.ask("status")["things_ahead"] if thing["surprise"]]


def test_a_lap_touches_each_surprise_exactly_once(scene: Scene) -> None:
    scene.ask("start")
    scene.pass_time(scene.world.trail.length / 2.5)
    surprises = {thing.id for thing in scene.world.things.values() if thing.surprise}
    assert sorted(scene.contacts()) == sorted(surprises)


def test_standing_against_a_thing_is_one_contact(scene: Scene) -> None:
    rover = scene.simulation.rover
    (drum,) = [thing for thing in scene.world.things.values() if thing.kind == "drum"]
    scene.ask("move", id=drum.id, x=rover.x, y=rover.y)
    scene.pass_time(2.0)
    assert scene.contacts() == [drum.id]


def test_a_thing_touched_again_after_it_was_left_is_counted_again(scene: Scene) -> None:
    rover = scene.simulation.rover
    (drum,) = [thing for thing in scene.world.things.values() if thing.kind == "drum"]
    for x in (rover.x, rover.x + 50.0, rover.x):
        scene.ask("move", id=drum.id, x=x, y=rover.y)
        scene.pass_time(0.2)
    assert scene.contacts() == [drum.id, drum.id]


def test_what_was_removed_is_neither_ahead_nor_touched(scene: Scene) -> None:
    scene.ask("start")
    scene.pass_time(3.0)
    first = surprises_ahead(scene)[0]
    scene.ask("remove", id=first["id"])
    assert surprises_ahead(scene) == []
    scene.pass_time(first["distance"] / 2.5 + 2.0)
    assert scene.contacts() == []


def test_a_hold_in_time_stops_before_the_thing_ahead_and_a_late_one_does_not() -> None:
    def ends_in_contact(hold_at: float) -> bool:
        scene = Scene()
        scene.ask("start")
        # The rover's nose and the thing's own radius come off the way that is left.
        while (ahead := surprises_ahead(scene)) == [] or ahead[0]["distance"] - 0.9 > hold_at:
            scene.simulation.advance(0.02)
        scene.ask("mode", mode="HOLD")
        scene.pass_time(9.0)
        assert scene.ask("status")["speed"] == 0.0
        return scene.contacts() != []

    assert not ends_in_contact(5.4)
    assert ends_in_contact(3.5)


def test_the_status_is_json_and_tells_where_the_rover_is(scene: Scene) -> None:
    scene.ask("start")
    scene.pass_time(10.0)
    status = json.loads(json.dumps(scene.ask("status"), allow_nan=False))
    assert status["mode"] == "AUTO"
    assert status["armed"] is True
    assert status["zone"] in ("meadow", "forest", "gravel")
    assert status["t"] == pytest.approx(10.0, abs=0.05)
    assert 15.0 < status["distance"] < 25.0
    assert status["mode_log"] == [{"t": 0.0, "mode": "AUTO", "by": "hand"}]


def test_the_hand_takes_over_and_lets_go_after_its_time(scene: Scene) -> None:
    scene.ask("start")
    scene.ask("mode", mode="MANUAL")
    scene.ask("throttle", throttle=1.0, seconds=2.0)
    scene.pass_time(2.0)
    assert scene.simulation.rover.speed > 1.0
    scene.pass_time(10.0)
    assert scene.simulation.rover.speed == 0.0
    assert scene.simulation.autopilot.mode is Mode.MANUAL


def test_a_long_gap_does_not_let_the_rover_run_on_unwatched(scene: Scene) -> None:
    scene.ask("start")
    scene.pass_time(8.0)
    before = scene.simulation.rover.distance
    scene.simulation.advance(30.0)
    assert scene.simulation.rover.distance - before <= 2.6 * LONGEST_GAP


def test_light_camera_switches_and_the_end_are_at_the_onlooker_s_hand(scene: Scene) -> None:
    scene.ask("light", level=0.4)
    scene.ask("film", fps=3)
    scene.ask("parameter", name="WP_SPEED", value=0.3)
    scene.ask("freeze_camera", on=True)
    scene.ask("rc", channel=7, pwm=1900)
    scene.ask("transmitter", on=False)
    scene.ask("stop")
    assert (scene.world.light, scene.frozen, scene.stopped) == (0.4, True, True)
    assert (scene.filmed, scene.simulation.rover.cruise_speed) == ([3.0], 0.3)
    assert scene.simulation.rover.transmitter.switches == {7: 1900}
    assert not scene.simulation.rover.transmitter.on


@pytest.mark.parametrize(
    ("request_", "complaint"),
    [
        ({"do": "fly"}, "there are look, status, arm"),
        ({"do": "remove"}, "such as drum-1"),
        ({"do": "remove", "id": "nothing"}, "such as drum-1"),
        ({"do": "remove", "id": ["drum-1"]}, "such as drum-1"),
        ({"do": "move", "id": "drum-1", "x": "left", "y": 0}, '"x" is a number'),
        ({"do": "move", "id": "drum-1", "x": float("nan"), "y": 0}, '"x" is a number'),
        ({"do": "mode", "mode": "FLY"}, "MANUAL, STEERING, HOLD"),
        ({"do": "mode", "mode": ["HOLD"]}, "MANUAL, STEERING, HOLD"),
        ({"do": "arm", "on": "yes"}, "true or false"),
        ({"do": "freeze_camera"}, "true or false"),
        ({"do": "light", "level": 7}, "from 0 to 1"),
        ({"do": "film", "fps": 0}, "from 0.2 to 60"),
        ({"do": "parameter", "name": "WP_SPEED", "value": 7}, "out of its range"),
        ({"do": "parameter", "name": "WP_SPED", "value": 1}, "no parameter"),
        ({"do": "light", "level": 10**400}, "from 0 to 1"),
        ({"do": "light", "level": True}, "from 0 to 1"),
        ({"do": "throttle", "throttle": 9}, "from -1 to 1"),
        ({"do": "throttle", "seconds": 1e9}, "from 0 to 60"),
        ({"do": "rc", "channel": 1, "pwm": 1500}, "from 5 to 16"),
        ({"do": "look"}, '"box" is left'),
        ({"do": "look", "box": [0.1, 0.2, 0.3, "low"]}, "from 0 to 1"),
        ({"do": "look", "box": [0.5, 0.2, 0.3, 0.4]}, "is empty"),
        ({"do": "look", "box": [0.1, 0.2, 0.3, 0.4], "at": -1}, "from 0 to inf"),
    ],
)
def test_a_bad_request_is_refused_with_what_to_send(
    scene: Scene, request_: dict[str, Any], complaint: str
) -> None:
    before = scene.ask("status")
    with pytest.raises(FieldError, match=complaint):
        scene.requests.handle(request_)
    assert scene.ask("status") == before


anything = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.lists(st.none())
SHARED = Scene()


@settings(max_examples=60, deadline=None)
@given(
    do=st.sampled_from(["arm", "freeze_camera", "light", "mode", "move", "rc", "remove", "throttle", "x"]),
    fields=st.dictionaries(
        st.sampled_from(["on", "level", "mode", "id", "x", "y", "channel", "pwm", "throttle", "seconds"]),
        anything | st.just("drum-1"),
    ),
)
def test_whatever_is_asked_the_answer_is_done_or_a_refusal(do: str, fields: dict[str, Any]) -> None:
    with contextlib.suppress(FieldError):
        assert SHARED.ask(do, **fields) == {"ok": True}
    SHARED.simulation.advance(0.1)
    json.dumps(SHARED.ask("status"), allow_nan=False)


def test_what_a_box_shows_is_told_to_an_onlooker() -> None:
    scene = Scene()
    assert scene.ask("look", box=[0.1, 0.2, 0.3, 0.4], at=7.5) == {"kind": "drum"}
    scene.ask("look", box=[0.1, 0.2, 0.3, 0.4])
    box = Box(0.1, 0.2, 0.3, 0.4)
    assert scene.looked == [(box, 7.5), (box, None)]
