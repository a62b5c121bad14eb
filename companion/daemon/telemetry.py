"""Gives the link the figures of judged frames and of this computer."""

from __future__ import annotations

from companion.calls.summary import summary
from companion.config.video import video_size
from companion.daemon.turn import Observer, Turn
from companion.link.link import Link


class Telemetry(Observer):
    """Observes judged frames. Not sent while a call is open: the numbers and the computer's figures."""

    def __init__(self, link: Link, view: int) -> None:
        """view: the camera's horizontal field of view, degrees, 0: unknown."""
        self._link = link
        self._view = view

    def see(self, turn: Turn) -> None:
        """Set the newest figures."""
        self._link.computer(turn.computer, turn.now)
        for judged in turn.judged:
            seen = judged.assessment
            self._link.camera.size = video_size(*seen.frame.image.shape[:2])
            self._link.summary(
                summary(seen, judged.sectors, turn.state, turn.policy, turn.current_id, self._view, turn.now),
                turn.now,
            )
            if seen.roi is not None:
                figures = {"AT_TRAV": seen.roi.traversability, "AT_UNC": seen.roi.uncertainty}
                if seen.similarity is not None:
                    figures["AT_SIM"] = seen.similarity
                self._link.numbers({**figures, "AT_CALL": float(turn.current_id)}, turn.now)
