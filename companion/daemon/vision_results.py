"""Has what vision reports stored, decided and carried out."""

from __future__ import annotations

from anytraverse.memory import Memory
from companion.calls.machine import OperatorCalls
from companion.daemon.answers.handler import AnswerHandler
from companion.daemon.call_frames import CallFrames
from companion.daemon.executor import DecisionExecutor
from companion.daemon.persistence import Persistence
from companion.daemon.requests import Requests
from companion.vision.client import VisionResult
from companion.vision.messages import Done, Drawn, FrameJudged


class VisionResults:
    """Handles the results one by one. A new memory is queued for the disk before its frame can count."""

    def __init__(
        self,
        calls: OperatorCalls,
        persistence: Persistence,
        frames: CallFrames,
        executor: DecisionExecutor,
        requests: Requests,
        answer_handler: AnswerHandler,
    ) -> None:
        self._calls = calls
        self._persistence = persistence
        self._frames = frames
        self._executor = executor
        self._requests = requests
        self._answer_handler = answer_handler

    def received(self, result: VisionResult, now: float) -> None:
        """Handle a result."""
        match result.report:
            case FrameJudged() as judged:
                self._judged(judged, result.memory, now)
            case Done() as done:
                self._applied(done, result, now)
            case Drawn() as drawn:
                self._frames.drawn(drawn)

    def _judged(self, judged: FrameJudged, memory: Memory, now: float) -> None:
        seen = judged.assessment
        self._persistence.save_memory(memory)
        self._frames.forget_lost()
        # A frame judged by words that a power loss may still undo can hold the vehicle, not release it.
        memory_stored = self._persistence.memory_stored(now, memory)
        decisions = self._calls.assessed(seen, now, memory_stored=memory_stored)
        self._executor.carry_out(decisions, now, at_once=True)
        if seen.adopted is not None:
            self._answer_handler.place_matched(now)
        self._frames.replace_lost(seen)

    def _applied(self, done: Done, result: VisionResult, now: float) -> None:
        self._persistence.save_memory(result.memory)
        if self._frames.is_call_frame(result.token):
            self._frames.call_frame_judged(done)
            return
        self._requests.applied(done, result, now)
        if done.outcome is not None:
            self._frames.answered(now)
