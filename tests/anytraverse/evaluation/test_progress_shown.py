"""A bar where somebody watches, lines where somebody reads later."""

from __future__ import annotations

import io

from anytraverse.evaluation.progress import Progress


class Terminal(io.StringIO):
    """A stream that says it is one."""

    def isatty(self) -> bool:
        """It does."""
        return True


class Clock:
    """A second for each look at it."""

    def __init__(self, tick: float = 1.0) -> None:
        self.now, self.tick = 0.0, tick

    def __call__(self) -> float:
        """Seconds."""
        self.now += self.tick
        return self.now


def test_a_file_gets_ten_lines_however_many_steps_there_are() -> None:
    for total in (10, 37, 1000):
        stream = io.StringIO()
        progress = Progress(total, "frames", stream, Clock())
        for _ in range(total):
            progress.step()
        progress.close()
        lines = stream.getvalue().splitlines()
        assert len(lines) == 10
        assert lines[-1] == f"{total}/{total} frames, {total} s, 0 s left"
        assert "\r" not in stream.getvalue()


def test_a_terminal_gets_a_bar_that_is_gone_at_the_end() -> None:
    stream = Terminal()
    progress = Progress(4, "frames", stream, Clock())
    progress.step()
    progress.step()
    assert stream.getvalue().endswith(f"\r[{'#' * 15}{'-' * 15}] 2/4 frames, 2 s, 2 s left\x1b[K")
    progress.say("0003.jpg: torn")
    assert stream.getvalue().endswith("\r\x1b[K0003.jpg: torn\n")
    progress.close()
    assert stream.getvalue().endswith("\r\x1b[K")


def test_many_steps_at_once_and_a_note_are_shown() -> None:
    stream = io.StringIO()
    progress = Progress(100, "steps", stream, Clock())
    for _ in range(4):
        progress.step(25, ", loss 0.5")
    assert stream.getvalue().splitlines()[0] == "25/100 steps, 1 s, 3 s left, loss 0.5"
    assert stream.getvalue().count("\n") == 4


def test_a_bar_is_not_drawn_more_often_than_anyone_sees() -> None:
    stream = Terminal()
    progress = Progress(1000, "frames", stream, Clock(tick=0.01))
    for _ in range(100):
        progress.step()
    assert 5 <= stream.getvalue().count("\r") <= 12
