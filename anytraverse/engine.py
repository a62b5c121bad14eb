"""The loop of the paper (AnyTraverse, arXiv 2506.16826), failing closed.

Scene changed -> the most similar remembered scene, if similar enough, gives its words, and the frame is
judged again before anything is reported. Otherwise, and for an unknown object, the operator must be called:
the reasons say so.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from anytraverse.adoption import adopted_memory, refused_memory
from anytraverse.answers import AnswerOutcome, changed_memory
from anytraverse.assessment import Assessment, Finding, Map, Maps, Observation, Reason
from anytraverse.errors import ExampleError, PerceiverError
from anytraverse.findings import check_age, find, find_scene, make_maps, roi_figures
from anytraverse.frame import Frame, is_black, is_image
from anytraverse.ground import STEEPEST
from anytraverse.history import Embedding, Match, Place, cosine, is_embedding
from anytraverse.judging import Settings
from anytraverse.light import Light, measure_light
from anytraverse.memory import Memory
from anytraverse.operations import Operation, OtherPlace, teaches
from anytraverse.perception import Features, Perceiver, Prompt, is_independent, is_joint, surroundings_of
from anytraverse.roi import RoiFigures
from anytraverse.scene_watch import SceneWatch
from anytraverse.synonyms import refuse_contradictions


class AnyTraverse:
    """Judges frames with the words in force, and learns from answers. One instance serves one thread.

    It has no clock: `now` is the caller's monotonic time in seconds, the one of `Frame.captured_at`.
    `memory` changes when words, the reference or the history change, and is never changed in place.
    """

    def __init__(self, perceiver: Perceiver, settings: Settings, memory: Memory) -> None:
        """Refuse a memory that the perceiver cannot use: see `resumed_memory`.

        Raises UnknownWordError for a word that it cannot ground, PreferencesError for words that contradict
        each other, PerceiverError and ExampleError for a memory or examples of another model.
        """
        _refuse_foreign(memory, perceiver.model_id)
        for word in memory.preferences:
            if word not in memory.examples:
                perceiver.meaning(word)
        refuse_contradictions(memory.preferences, perceiver.meaning)
        self.perceiver = perceiver
        self.settings = settings
        self.memory = memory
        self.newest: Observation | None = None
        self._matched: deque[bool] = deque(maxlen=settings.window)
        self._scenes = SceneWatch()

    def observe(self, frame: Frame) -> Observation:
        """Encode a frame and calculate its embedding: the expensive part, whatever came before.

        Raises PerceiverError when the perceiver fails on it.
        """
        features = self.perceiver.encode(frame.image)
        return Observation(frame, features, self._embed(features))

    def step(self, frame: Frame, now: float, place: Place | None = None) -> Assessment:
        """Judge a new frame; adopt a remembered scene when the last frames matched one.

        Without a reference, the first frame without a fault becomes the reference. Where the scene is not in
        doubt, the embedding of an earlier frame may be used: see `SceneWatch`.
        """
        assessment = self._step(frame, now, place or Place())
        self._scenes.judged(assessment)
        return assessment

    def _step(self, frame: Frame, now: float, place: Place) -> Assessment:
        assessment = self._judge_new(frame, now)
        observation = assessment.observation
        if observation is None or Reason.FAULT in assessment.reasons:
            self._matched.append(False)
            return assessment
        if self.memory.reference is None:
            seen = surroundings_of(self.perceiver, observation.features)
            self.memory = self.memory.remembering(
                observation.embedding, 0, place, move=True, surroundings=seen
            )
            assessment = self.judge(observation, now)
        match, undecided = self._match(observation)
        self._matched.append(match is not None)
        changed = assessment.finding(Reason.UNKNOWN_SCENE)
        if match is None and changed is not None and assessment.similarity is not None:
            least = self.settings.thresholds.least_match(len(self.memory.history))
            now_alike = assessment.similarity  # to the place in force: its surroundings may be more alike
            like = self.memory.likeness(observation.embedding, now_alike, changed.threshold, least)
            assessment = replace(assessment, likeness=like)
        if match is None and not undecided:
            return assessment
        if match is None or sum(self._matched) < self.settings.votes:
            return replace(assessment, match=match, undecided=undecided)
        self.memory, dropped = adopted_memory(
            self.memory, match, self.perceiver.meaning, observation.embedding, place.time
        )
        self._matched.clear()
        return replace(self.judge(observation, now), match=match, adopted=match.entry, dropped=dropped)

    def judge(self, observation: Observation, now: float) -> Assessment:
        """Judge a frame with the words in force; no encoding. Changes nothing.

        Raises UnknownWordError and ExampleError for words that the perceiver refuses after all.
        """
        frame, words = observation.frame, self.memory.preferences
        age = now - frame.captured_at
        similarity = self._similarity(observation.embedding)
        findings = check_age(age, self.settings.freshness)
        if self.memory.reference is None and is_black(frame.image):
            findings.append(Finding.fault("the picture is black"))
        judged = self._known_similarity(observation, similarity)
        seen = partial(
            Assessment,
            frame,
            words,
            age=age,
            similarity=similarity if similarity is not None and math.isfinite(similarity) else None,
            scene_age=observation.scene_age,
            light=self.light_of(observation),
            observation=observation,
        )
        maps = self.maps_of(observation)
        if isinstance(maps, Finding):
            return seen((*findings, maps, *find_scene(judged, self.settings)))
        roi = self.figures_of(observation, maps)
        if isinstance(roi, Finding):
            return seen((*findings, roi, *find_scene(judged, self.settings)), maps=maps)
        return seen((*findings, *find(roi, len(words), judged, self.settings)), maps=maps, roi=roi)

    def maps_of(self, observation: Observation) -> Maps | Finding:
        """Make a frame's maps with the words in force, or say which fault prevents it.

        Changes nothing but `Observation.attended`. Raises as `judge` does.
        """
        try:
            attention, alone = self._attend(observation)
            weights = list(self.memory.preferences.values())
            return make_maps(attention, weights, self.settings, alone, joint=is_joint(self.perceiver))
        except PerceiverError as error:
            return Finding.fault(str(error))

    def light_of(self, observation: Observation) -> Light:
        """Measure the light of a frame's picture."""
        return measure_light(observation.frame.image)

    def figures_of(self, observation: Observation, maps: Maps) -> RoiFigures | Finding:
        """Calculate the figures of the region of interest, or say which fault prevents it."""
        frame = observation.frame
        (height, width), lean = frame.image.shape[:2], frame.lean
        if self.settings.metres is not None and lean is not None and max(map(abs, lean)) > STEEPEST:
            return Finding.fault(f"the vehicle leans by {max(map(abs, lean)):.0f} degrees")
        return roi_figures(maps, width / height, self.settings.at(lean, frame.reach))

    def answer(
        self,
        operations: Sequence[Operation],
        now: float,
        *,
        call: Observation | None = None,
        call_id: int = 0,
        go: bool = False,
        place: Place | None = None,
        missing_ok: bool = False,
        match: int | None = None,
    ) -> AnswerOutcome:
        """Apply an operator's answer, all or nothing, and judge the call's and the newest frame again.

        call: the frame of the call that is answered; None for words without a call, which teach no scene.
        Only operations that teach and go enter the scene into H and move the reference to it, the latter only
        if the newest frame still resembles it: for these two an earlier frame's embedding will not do, and
        each gets its own. A refused match is undone first, whatever else changes.
        missing_ok: as of `changed_memory`. match: the stamp of the match that is refused (`Adoption.clock`),
        None: any. Raises PreferencesError, ExampleError, RegionError, PerceiverError; then nothing has
        changed.
        """
        before = self.memory
        learns = go or teaches(operations)
        refused = [one.id for one in operations if isinstance(one, OtherPlace)]
        undone, forgotten = tuple[str, ...](), tuple[int, ...]()
        try:
            if call is not None and learns:
                self._see_scene(call)
            if (call is not None and learns) or refused:
                self._see_scene(self.newest)
            if refused:
                newest = self.newest.embedding if self.newest is not None else None
                limits, meaning = self.settings.thresholds, self.perceiver.meaning
                self.memory, undone, forgotten = refused_memory(
                    before, refused[-1], newest, limits, meaning, stamp=match
                )
            self.memory, dropped = changed_memory(
                self.memory, operations, self.perceiver, call, missing_ok=missing_ok
            )
            remembered = False
            if call is not None and learns and is_embedding(call.embedding):
                self.memory = self.memory.remembering(
                    call.embedding,
                    call_id,
                    place or Place(),
                    move=self._is_at(call.embedding),
                    surroundings=surroundings_of(self.perceiver, call.features),
                )
                remembered = True
            outcome = AnswerOutcome(
                call=self._judge_in_time(call) if call is not None else None,
                newest=self.judge(self.newest, now) if self.newest is not None else None,
                dropped=dropped,
                remembered=remembered,
                undone=undone,
                forgotten=forgotten,
            )
            if refused:
                self._matched.clear()
            return outcome
        except Exception:
            self.memory = before
            raise

    def fault(self, frame: Frame, now: float, why: str) -> Assessment:
        """Return the assessment of a frame that could not be judged."""
        return Assessment(frame, self.memory.preferences, (Finding.fault(why),), now - frame.captured_at)

    def _judge_new(self, frame: Frame, now: float) -> Assessment:
        if not is_image(frame.image):
            return self.fault(frame, now, "the frame is not a picture")
        try:
            self.newest = self._observe_next(frame, now)
        except PerceiverError as error:
            return self.fault(frame, now, str(error))
        return self.judge(self.newest, now)

    def _observe_next(self, frame: Frame, now: float) -> Observation:
        """Encode a frame as `observe` does. Where the scene is not in doubt, use the last embedding."""
        scene = self._scenes.take(self.settings, self.memory.reference, now)
        features = self.perceiver.encode(frame.image)
        if scene is None:
            return Observation(frame, features, self._embed(features))
        return Observation(frame, features, scene.embedding, scene_at=scene.at)

    def _see_scene(self, observation: Observation | None) -> None:
        """Replace an earlier frame's embedding in `observation` by one of its own frame."""
        if observation is not None and observation.scene_at is not None:
            observation.embedding, observation.scene_at = self._embed(observation.features), None

    def _embed(self, features: Features) -> Embedding:
        return np.array(self.perceiver.embed(features), dtype=np.float32)

    def _judge_in_time(self, call: Observation) -> Assessment:
        """Judge the call's frame as if it were fresh: the words are not to blame for its age."""
        return self.judge(call, call.frame.captured_at)

    def _attend(self, observation: Observation) -> tuple[Map, Map | None]:
        """Return the attention maps of the words in force, and those of the drivable words asked for alone.

        The second is None for an `independent` perceiver: there a word's map does not depend on the other
        words, so both are the same. The perceiver is not asked again after a change of weights that turns no
        sign.
        """
        memory, kept = self.memory, observation.attended
        if is_independent(self.perceiver):
            prompts = tuple(Prompt(word, memory.examples.get(word, ())) for word in memory.preferences)
            whole = kept[prompts] if prompts in kept else self.perceiver.attend(observation.features, prompts)
            observation.attended = {prompts: whole}
            return whole, None
        prompts = tuple(
            Prompt(word, memory.examples.get(word, ()), weight > 0)
            for word, weight in memory.preferences.items()
        )
        alone = tuple(prompt for prompt in prompts if prompt.drivable)
        observation.attended = {asked: kept[asked] for asked in (prompts, alone) if asked in kept}
        for asked in (prompts, alone):
            if asked not in observation.attended:
                observation.attended[asked] = self.perceiver.attend(observation.features, asked)
        return observation.attended[prompts], observation.attended[alone]

    def _similarity(self, embedding: Embedding) -> float | None:
        """Return the cosine to the reference, None without one; NaN for an embedding of other numbers."""
        if self.memory.reference is not None:
            return cosine(self.memory.reference, embedding)
        return None if is_embedding(embedding) else math.nan

    def _known_similarity(self, observation: Observation, similarity: float | None) -> float | None:
        """Return the similarity by which the scene is judged: to the reference, or of its surroundings.

        Surroundings with a strangeness of at most 1 make a new place known, unless an operator said of a
        frame like this one that it shows another place. Where the strangeness is above 1 to each remembered
        scene, every place is new: a covered lens shows little, and that little may resemble the reference. A
        strangeness of 1 gives the perceiver's own threshold of the scene.
        """
        if similarity is None or not math.isfinite(similarity):
            return similarity
        surroundings = surroundings_of(self.perceiver, observation.features)
        if surroundings is None:
            return similarity
        history, varying = self.memory.history, 1.0 - self.perceiver.defaults.scene
        strange = history.strangeness(surroundings, self.memory.preferences)
        if strange is not None and strange <= 1.0:
            refused = history.is_refused(observation.embedding, self.settings.thresholds.scene)
            return similarity if refused else max(similarity, 1.0 - varying * strange)
        nearest = history.nearest_strangeness(surroundings)
        if nearest is not None and nearest > 1.0:
            return min(similarity, max(-1.0, 1.0 - varying * nearest))
        return similarity

    def _is_at(self, embedding: Embedding) -> bool:
        """Return whether the newest frame still shows the scene of `embedding`."""
        newest = self.newest
        return newest is not None and cosine(newest.embedding, embedding) >= self.settings.thresholds.scene

    def _match(self, observation: Observation) -> tuple[Match | None, bool]:
        """Return the remembered scene that a changed scene matches, and whether the scene is undecided.

        A scene counts as changed although its surroundings are familiar: its place may have words of its own.

        A match may need more similarity than the scene's threshold. The similarities of frames of one place
        scatter about that number. So a frame that misses it by at most the margin leaves the scene undecided.
        """
        found = find_scene(self._similarity(observation.embedding), self.settings)
        if not any(finding.bad for finding in found):
            return None, False
        history, limits = self.memory.history, self.settings.thresholds
        best, least = history.best(observation.embedding), limits.least_match(len(history))
        if best is None or best.similarity < max(limits.scene, least - limits.similarity_margin):
            return None, False
        known = self._known_similarity(observation, best.similarity)
        if known is None or known < limits.scene:
            return None, False  # its surroundings are foreign
        return best if best.similarity >= least else None, True


def _refuse_foreign(memory: Memory, model_id: str) -> None:
    if memory.model_id != model_id:
        raise PerceiverError(
            f"the memory belongs to model {memory.model_id}, the perceiver is {model_id}: resume it first"
        )
    for word, examples in memory.examples.items():
        if any(example.model_id != model_id for example in examples):
            raise ExampleError(f'an example of "{word}" is not of model {model_id}: tap the thing again')
