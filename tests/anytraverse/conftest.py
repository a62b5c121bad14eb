"""A perceiver that sees what the test paints, and a rover that drives past the paintings."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import starmap
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
import pytest
from hypothesis import settings
from numpy.typing import NDArray

from anytraverse.answers import AnswerOutcome
from anytraverse.assessment import Assessment, Observation
from anytraverse.engine import AnyTraverse
from anytraverse.errors import UnknownWordError
from anytraverse.frame import Frame, Image
from anytraverse.judging import Settings
from anytraverse.memory import Memory, first_memory
from anytraverse.operations import ForgetCall, ForgetWord, NewEpisode, OtherPlace, SetWord, Tap
from anytraverse.perception import DefaultThresholds, Example, Prompt
from anytraverse.preferences import Preferences
from anytraverse.regions import Box

settings.register_profile("steady", derandomize=True, deadline=None)
settings.load_profile("steady")

HEIGHT, WIDTH = 40, 60
GNOME = 99
"""What no word of the vocabulary means: it can only be tapped."""
CODES = {"grass": 1, "trail": 2, "drum": 3, "rock": 4} | {f"kind {n}": 10 + n for n in range(20)}
MEANINGS = {"path": "trail", "barrel": "drum", "lawn": "grass"} | {word: word for word in CODES}
AHEAD = Box(0.4, 0.65, 0.6, 0.9)
"""A third of the default ROI, in its middle."""


class Painted:
    """A perceiver for painted pictures: red says what stands there, green how sure it is, blue which scene.

    It counts its work. What is put in the place of `spoil_...` changes what it answers.
    """

    model_id = "painted-1"
    independent = True
    vocabulary: tuple[str, ...] | None = tuple(MEANINGS)
    defaults = DefaultThresholds(roi=0.3, scene=0.85)

    def __init__(self) -> None:
        self.encoded = self.attended = self.embedded = 0
        self.spoil_attention: Callable[[NDArray[np.float32]], NDArray[Any]] = lambda maps: maps
        self.spoil_embedding: Callable[[NDArray[np.float32]], NDArray[Any]] = lambda vector: vector
        self.spoil_example: Callable[[Example], Example] = lambda example: example

    def meaning(self, word: str) -> str:
        """The word's first synonym."""
        if word not in MEANINGS:
            raise UnknownWordError(word, tuple(MEANINGS))
        return MEANINGS[word]

    def encode(self, image: Image) -> Image:
        """The picture itself."""
        self.encoded += 1
        return image

    def attend(self, features: Image, prompts: Sequence[Prompt]) -> NDArray[np.float32]:
        """As sure as painted where the word or an example of it is painted, 0 elsewhere."""
        self.attended += 1
        sure = features[..., 1] / np.float32(200)
        maps = np.zeros((len(prompts), *sure.shape), dtype=np.float32)
        for index, prompt in enumerate(prompts):
            codes = [int(example.vector[0]) for example in prompt.examples]
            if prompt.word in MEANINGS or not codes:
                codes.append(CODES[self.meaning(prompt.word)])
            maps[index] = np.where(np.isin(features[..., 0], codes), sure, 0)
        return self.spoil_attention(maps)

    def embed(self, features: Image) -> NDArray[np.float32]:
        """A direction in the plane: two scenes differ by the angle between them."""
        self.embedded += 1
        angle = math.radians(float(features[0, 0, 2]))
        return self.spoil_embedding(np.array([math.cos(angle), math.sin(angle)], dtype=np.float32))

    def example(self, features: Image, box: Box) -> Example:
        """What stands in the middle of the box."""
        x, y = box.centre
        code = features[int(y * HEIGHT), int(x * WIDTH), 0]
        return self.spoil_example(Example(self.model_id, np.array([code], dtype=np.float32)))


class Rover:
    """An engine with painted eyes and a clock of its own. Frames are 0.1 s old when they are judged."""

    def __init__(self, words: str, settings: Settings | None = None, memory: Memory | None = None) -> None:
        self.eyes = Painted()
        self.now = 100.0
        self.frame_id = 0
        memory = memory or first_memory(self.eyes.model_id, Preferences.parse(words))
        self.engine = AnyTraverse(self.eyes, settings or Settings(), memory)

    @property
    def memory(self) -> Memory:
        """What the engine remembers."""
        return self.engine.memory

    def frame(self, scene: int = 0, ground: str = "grass", thing: str = "", sure: float = 1.0) -> Frame:
        """A picture of `ground` with a `thing` ahead, in a scene at an angle of 0 to 180 degrees."""
        image = np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8)
        image[..., 0] = CODES[ground]
        image[..., 1] = round(200 * sure)
        image[..., 2] = scene
        if thing:
            image[..., 0][AHEAD.slices(HEIGHT, WIDTH)] = CODES.get(thing, GNOME)
        image.flags.writeable = False
        self.frame_id += 1
        self.now += 0.2
        return Frame(self.frame_id, self.now - 0.1, image)

    def see(
        self, scene: int = 0, ground: str = "grass", thing: str = "", sure: float = 1.0, **changed: Any
    ) -> Assessment:
        """Take a frame and judge it; `changed` alters the frame first."""
        return self.engine.step(replace(self.frame(scene, ground, thing, sure), **changed), self.now)

    def call(self, scene: int = 0, ground: str = "grass", thing: str = "") -> Observation:
        """See something about which a call is made."""
        observation = self.see(scene, ground, thing).observation
        assert observation is not None
        return observation

    def answer(
        self,
        weights: Mapping[str, float] | None = None,
        call: Observation | None = None,
        call_id: int = 0,
        *,
        go: bool = False,
        taps: tuple[Tap, ...] = (),
        forget: tuple[str, ...] = (),
        forget_calls: tuple[int, ...] = (),
        new_episode: bool = False,
        missing_ok: bool = False,
        other_place: int | None = None,
    ) -> AnswerOutcome:
        """Answer as the operator would."""
        operations = (
            *starmap(SetWord, (weights or {}).items()),
            *taps,
            *map(ForgetWord, forget),
            *map(ForgetCall, forget_calls),
            *((NewEpisode(),) if new_episode else ()),
            *((OtherPlace(other_place),) if other_place is not None else ()),
        )
        return self.engine.answer(
            operations, self.now, call=call, call_id=call_id, go=go, missing_ok=missing_ok
        )


@pytest.fixture(scope="session")
def make_rover() -> type[Rover]:
    """A rover for configured words and settings."""
    return Rover


@pytest.fixture
def rover() -> Rover:
    """A rover that may drive on grass, not on rock, and has seen the scene at 0 degrees."""
    rover = Rover("grass: 1; rock: -1")
    rover.see()
    return rover


@pytest.fixture
def ahead() -> Box:
    """Where a thing is painted."""
    return AHEAD


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Every network that is run, by the name of its file."""
    ran: list[str] = []
    run = onnxruntime.InferenceSession.run

    def counted(self: Any, *given: Any, **options: Any) -> Any:
        ran.append(Path(self._model_path).stem)
        return run(self, *given, **options)

    monkeypatch.setattr(onnxruntime.InferenceSession, "run", counted)
    return ran
