"""The script that guides, on any sequence of events: whose mode it never changes, and when it stops."""

from __future__ import annotations

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from companion.wire.ids import State
from tests.companion.sim.field.guiding import GUIDE, LONGEST, LOST, STATION, Guiding
from tests.companion.sim.field.stubs import AUTO, BY_GCS, BY_RC, CYCLE, GUIDED, HOLD, MANUAL, RTL, SCRIPTING
from tests.companion.sim.field.test_script_brakes import COMMANDS

pytest.importorskip("lupa.lua53", reason="the script runs in Lua 5.3")

Step = tuple[str, int, int]
SPARE = 0.3
MODES = st.sampled_from([MANUAL, HOLD, AUTO, RTL, GUIDED, 5])
REASONS = st.sampled_from([BY_GCS, BY_RC])
STEPS = st.one_of(
    st.tuples(st.just("human"), MODES, REASONS),
    st.tuples(st.just("through"), MODES, REASONS),
    st.tuples(st.just("meets"), MODES, st.integers(0, 5)),
    st.tuples(st.just("command"), st.integers(0, len(COMMANDS) - 1), st.just(0)),
    st.tuples(st.just("guide"), st.just(0), st.just(0)),
    st.tuples(st.just("back"), st.just(0), st.just(0)),
    st.tuples(st.just("hold"), st.sampled_from([AUTO, GUIDED]), st.just(0)),
    st.tuples(st.just("go"), st.sampled_from([AUTO, GUIDED]), st.just(0)),
    st.tuples(st.just("again"), st.integers(0, 3), st.just(0)),
    st.tuples(st.just("streams"), st.sampled_from([0, 1, 1]), st.just(0)),
    st.tuples(st.just("guides"), st.sampled_from([0, 1, 1]), st.just(0)),
    st.tuples(st.just("beats"), st.sampled_from([0, 1, 1]), st.just(0)),
    st.tuples(st.just("speed"), st.sampled_from([0, 1, 1]), st.just(0)),
    st.tuples(st.just("seconds"), st.sampled_from([0, 1, 4]), st.just(0)),
    st.tuples(st.just("fault"), st.just(0), st.just(0)),
    st.tuples(st.just("restart"), st.just(0), st.just(0)),
    st.tuples(st.just("time"), st.sampled_from([1, 3, 8, 55]), st.just(0)),
)


class Witness:
    """Watches each mode that the script sets.

    ours: GUIDED was set for guiding. theirs: a human's target or GUIDED command has taken it since.
    """

    def __init__(self, *, guided: bool) -> None:
        self.asked = Guiding()
        if guided:
            self.asked.guided()
        self.board = self.asked.board
        self.ours, self.theirs = guided, False
        self.asks: list[tuple[float, float, float, float]] = []

    def take(self, step: Step) -> None:
        kind, value, more = step
        asked, board = self.asked, self.board
        if kind == "human":
            board.human_sets(value, more)
        elif kind == "through":  # within one cycle of the script's, in which more may happen
            board.human_sets(MANUAL if value != MANUAL else HOLD, more)
            board.human_sets(value, more)
        elif kind == "meets":
            board.meet(lambda: board.human_sets(value, BY_RC), more)
        elif kind == "command":
            asked.hears(COMMANDS[value](), STATION)
            self.theirs = board.mode_now == GUIDED
        elif kind in ("guide", "back", "hold", "go"):
            self._asks(kind, value)
        elif kind == "again" and self.asks:
            mode, expected, hold, serial = self.asks[-1 - value % len(self.asks)]
            asked.send(mode, expected, hold=hold, serial=serial)
        elif kind in ("streams", "guides", "beats"):
            setattr(asked, kind, bool(value))
        elif kind == "speed":
            board.moves_at = float(value)
        elif kind == "seconds":
            asked.seconds = float(value)
        elif kind == "restart":
            board.scripting.restart()
            self.ours = False
        if kind == "through":
            return
        for _ in range(value if kind == "time" else 1):
            self.cycle(State.FAULT if kind == "fault" else State.OK)

    def _asks(self, kind: str, value: int) -> None:
        mode, expected, hold = {
            "guide": (GUIDED, AUTO, GUIDE),
            "back": (AUTO, GUIDED, GUIDE),
            "hold": (HOLD, value, 7),
            "go": (value, HOLD, 7),
        }[kind]
        self.asked.send(mode, expected, hold=hold)
        self.asks.append((mode, expected, hold, self.asked.serial))

    def cycle(self, state: State) -> None:
        board = self.board
        before, reason = board.mode_now, board.reason
        known = len(board.set_modes)
        met = board.between is not None
        self.asked.live(CYCLE, state)
        steps = board.set_modes[known:]
        if met:  # somebody may have come between: what each step found is in the steps alone
            self.ours &= board.mode_now == GUIDED and board.reason == SCRIPTING
        else:
            self.check(before, reason, [mode for _, mode, _, _ in steps])
        self.theirs = self.theirs and board.mode_now == GUIDED

    def check(self, before: int, reason: int, steps: list[int]) -> None:
        if not steps:
            return
        if reason != SCRIPTING:
            # A human's AUTO or GUIDED may be held out of, and AUTO guided out of; nothing else changes.
            assert before in (AUTO, GUIDED), (before, reason, steps)
            assert before == AUTO or AUTO not in steps, (before, reason, steps)
        if AUTO in steps and before == GUIDED:
            assert self.ours, "AUTO out of a GUIDED that is not ours"
            assert not self.theirs, "AUTO out of a GUIDED that somebody took"
        guided = before == AUTO and steps[-1] == GUIDED
        self.ours = (self.ours and before == GUIDED) or guided
        if guided:
            self.theirs = False


@pytest.mark.slow
@settings(max_examples=300, deadline=None)
@given(st.lists(STEPS, max_size=30), st.booleans())
@example(steps=[("command", 0, 0), ("back", 0, 0)], guided=True)
@example(steps=[("through", GUIDED, BY_RC), ("back", 0, 0)], guided=True)
@example(steps=[("streams", 0, 0), ("time", 5, 0), ("through", GUIDED, BY_RC), ("time", 8, 0)], guided=True)
def test_no_mode_of_a_human_s_is_changed_and_no_auto_set_out_of_a_guided_that_is_not_ours(
    steps: list[Step], guided: bool
) -> None:
    witness = Witness(guided=guided)
    for step in steps:
        witness.take(step)
    assert witness.board.scripting.ended == ""
    assert not [text for text in witness.board.texts() if "anytraverse.lua" in text]


@pytest.mark.slow
@settings(max_examples=300, deadline=None)
@given(st.lists(STEPS, max_size=20), st.sampled_from([0, 1, 4]))
def test_a_rover_that_is_guided_is_in_hold_soon_after_its_last_target_unless_somebody_took_over(
    steps: list[Step], seconds: int
) -> None:
    witness = Witness(guided=False)
    asked, board = witness.asked, witness.board
    asked.guides = asked.beats = True
    board.human_sets(AUTO)
    asked.seconds = float(seconds)
    for step in steps:
        witness.take(step)
    # Whatever was before: a human sets AUTO, and it is guided.
    board.between = None
    board.human_sets(AUTO if board.mode_now != AUTO else MANUAL)
    asked.live(CYCLE)
    board.human_sets(AUTO)
    asked.guides = asked.beats = asked.streams = True
    asked.seconds = float(seconds)
    asked.live(6.0)
    asked.ask(GUIDED, AUTO, hold=GUIDE)
    assert (board.mode_now, board.reason) == (GUIDED, SCRIPTING)
    asked.live(1.0)
    for step in steps:
        if step[0] in ("beats", "guides", "speed", "fault", "again"):
            witness.take(step)
    asked.streams = False
    assert asked.until_held(LOST + LONGEST + 1) <= LOST + seconds + SPARE
    assert board.reason == SCRIPTING
