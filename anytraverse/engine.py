"""The loop of the paper (AnyTraverse, arXiv 2506.16826), failing closed.

Scene changed -> the most similar remembered scene, if similar enough, gives its words, and the frame is judged
again before anything is reported. Otherwise, and for an unknown object, the operator must be called: the
reasons say so.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np

from anytraverse.answers import AnswerOutcome, Changes, changed_memory
from anytraverse.assessment import Assessment, Finding, Observation, Reason
from anytraverse.frame import Frame, is_black, is_image
from anytraverse.history import Embedding, Entry, Match, Place
from anytraverse.judging import Settings, find, make_maps, roi_figures
from anytraverse.memory import Memory
from anytraverse.perception import Perceiver, Prompt
from anytraverse.preferences import Preferences


class AnyTraverse:
    """Frames in, assessments out. One instance serves one thread.

    It has no clock: `now` is the caller's monotonic time in seconds, the one of `Frame.captured_at`.
    `memory` changes when words, the reference or the history change, and is never changed in place.
    """

    def __init__(self, perceiver: Perceiver, settings: Settings, memory: Memory) -> None:
        """Raises UnknownWordError for a word of the memory that the perceiver cannot ground."""
        for word in memory.preferences:
            if word not in memory.examples:
                perceiver.meaning(word)
        self.perceiver = perceiver
        self.settings = settings
        self.memory = memory
        self.newest: Observation | None = None
        self._matched: deque[bool] = deque(maxlen=settings.window)

    def observe(self, frame: Frame) -> Observation:
        """The one expensive pass over a frame."""
        features = self.perceiver.encode(frame.image)
        return Observation(frame, features, self.perceiver.embed(features))

    def step(self, frame: Frame, now: float, place: Place | None = None) -> Assessment:
        """Judge a new frame; adopt a remembered scene when the last frames matched one."""
        if not is_image(frame.image):
            return self.fault(frame, now, "the frame is not a picture")
        observation = self.observe(frame)
        self.newest = observation
        if (
            self.memory.reference is None
            and np.isfinite(observation.embedding).all()
            and not is_black(frame.image)
        ):
            self._remember(observation.embedding, 0, place or Place())
        assessment = self.judge(observation, now)
        match = self._match(assessment, observation)
        self._matched.append(match is not None)
        if match is None:
            return assessment
        if sum(self._matched) < self.settings.votes:
            return replace(assessment, match=match)
        self._adopt(match.entry)
        self._matched.clear()
        return replace(self.judge(observation, now), match=match, adopted=match.entry)

    def judge(self, observation: Observation, now: float) -> Assessment:
        """Judge a frame with the words in force; no encoding. Changes nothing."""
        words = self.memory.preferences
        age = now - observation.frame.captured_at
        findings: list[Finding] = []
        if not 0.0 <= age <= self.settings.freshness:
            findings.append(Finding.fault(f"the frame is {age:.1f} s old"))
        similarity = self._similarity(observation.embedding)
        maps = make_maps(self._attend(observation), list(words.values()), self.settings)
        if isinstance(maps, Finding):
            return Assessment(observation.frame, words, (*findings, maps), age, observation=observation)
        height, width = observation.frame.image.shape[:2]
        roi = roi_figures(maps, width / height, self.settings)
        if isinstance(roi, Finding):
            return Assessment(observation.frame, words, (*findings, roi), age, maps, observation=observation)
        findings.extend(find(maps, roi, similarity, self.settings))
        return Assessment(
            observation.frame, words, tuple(findings), age, maps, roi, similarity, observation=observation
        )

    def answer(
        self,
        changes: Changes,
        now: float,
        *,
        call: Observation | None = None,
        call_id: int = 0,
        go: bool = False,
        place: Place | None = None,
    ) -> AnswerOutcome:
        """Apply an operator's answer, all or nothing, and judge the call's and the newest frame again.

        call: the frame of the call that is answered; None for words without a call, which teach no scene.
        Only changes and go enter the scene into H and move the reference to it, the latter only if the newest
        frame still resembles it. Raises PreferencesError, ExampleError; then nothing has changed.
        """
        before = self.memory
        try:
            self.memory, dropped = changed_memory(before, changes, self.perceiver, call)
            remembered = False
            if call is not None and (changes or go) and np.isfinite(call.embedding).all():
                self._remember(
                    call.embedding, call_id, place or Place(), move=self._resembles(call.embedding)
                )
                remembered = True
            return AnswerOutcome(
                call=self._judge_in_time(call) if call is not None else None,
                newest=self.judge(self.newest, now) if self.newest is not None else None,
                dropped=dropped,
                remembered=remembered,
            )
        except Exception:
            self.memory = before
            raise

    def _judge_in_time(self, call: Observation) -> Assessment:
        """The call's frame judged as if it were fresh: its age is no fault of the words."""
        return self.judge(call, call.frame.captured_at)

    def _attend(self, observation: Observation) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
        """Attention maps of the words in force; a change of weights alone runs no network."""
        memory = self.memory
        prompts = tuple(Prompt(word, memory.examples.get(word, ())) for word in memory.preferences)
        if observation.attended is None or observation.attended[0] != prompts:
            observation.attended = prompts, self.perceiver.attend(observation.features, prompts)
        return observation.attended[1]

    def _similarity(self, embedding: Embedding) -> float | None:
        if self.memory.reference is None:
            return None
        return float(self.memory.reference @ embedding)

    def _resembles(self, embedding: Embedding) -> bool:
        newest = self.newest
        return newest is None or float(newest.embedding @ embedding) >= self.settings.thresholds.scene

    def _match(self, assessment: Assessment, observation: Observation) -> Match | None:
        if Reason.UNKNOWN_SCENE not in assessment.reasons:
            return None
        best = self.memory.history.best(observation.embedding)
        return best if best is not None and best.similarity >= self.settings.thresholds.scene else None

    def _adopt(self, entry: Entry) -> None:
        """The entry's words win, but for those that the operator touched later."""
        memory = self.memory
        words = {
            word: setting
            for word, setting in entry.preferences.settings.items()
            if memory.touched_by(word) <= entry.order
        }
        preferences = memory.preferences.merged(Preferences(words))
        examples = {**memory.examples, **{w: entry.examples[w] for w in words if w in entry.examples}}
        clock = memory.clock + 1
        self.memory = replace(
            memory,
            preferences=preferences,
            examples={word: kept for word, kept in examples.items() if word in preferences},
            reference=entry.embedding,
            history=memory.history.touched(entry, clock),
            clock=clock,
        )

    def _remember(self, embedding: Embedding, call_id: int, place: Place, *, move: bool = True) -> None:
        memory = self.memory
        clock = memory.clock + 1
        entry = Entry(embedding, memory.preferences, clock, clock, call_id, memory.examples, place)
        kept = memory.history.without_call(call_id) if call_id else memory.history
        self.memory = replace(
            memory,
            history=kept.added(entry),
            reference=embedding if move else memory.reference,
            clock=clock,
        )

    def fault(self, frame: Frame, now: float, why: str) -> Assessment:
        """The assessment of a frame that could not be judged."""
        return Assessment(frame, self.memory.preferences, (Finding.fault(why),), now - frame.captured_at)
