"""What a frame, an answer and a broken network cost and lead to when CLIPSeg are the eyes."""

from __future__ import annotations

import gc
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
import pytest

from anytraverse.assessment import Reason
from anytraverse.engine import AnyTraverse
from anytraverse.export.making import make_bundle
from anytraverse.export.random_weights import TINY, random_clipseg
from anytraverse.frame import Frame
from anytraverse.judging import Settings
from anytraverse.memory import first_memory
from anytraverse.operations import ForgetWord, SetWord
from anytraverse.perception import make_perceiver
from anytraverse.perception.runtime import Runtime
from anytraverse.preferences import Preferences

TEXT = ["text-1", "text-2", "text-3"]


def engine_of(bundle: Path, words: str = "grass: 1; rock: -1", **settings: Any) -> AnyTraverse:
    """An engine with the bundle's eyes."""
    perceiver = make_perceiver(f"clipseg:{bundle}", Runtime(threads=1))
    memory = first_memory(perceiver.model_id, Preferences.parse(words))
    return AnyTraverse(perceiver, Settings(freshness=10.0, **settings), memory)


def frame(number: int) -> Frame:
    """One a second."""
    image = np.random.default_rng(number).integers(0, 256, (48, 64, 3), dtype=np.uint8)
    return Frame(number, float(number), image)


def test_a_frame_runs_tower_tail_and_decoder_and_the_first_one_the_text(tiny: Path, runs: list[str]) -> None:
    engine = engine_of(tiny)
    engine.step(frame(1), 1.0)
    assert list(dict.fromkeys(runs)) == ["image", "tail", *TEXT, "decoder"]
    runs.clear()
    engine.step(frame(2), 2.0)
    assert runs == ["image", "tail", "decoder"]


def test_a_changed_weight_is_in_the_next_assessment_without_a_network(tiny: Path, runs: list[str]) -> None:
    engine = engine_of(tiny)
    before = engine.step(frame(1), 1.0)
    runs.clear()
    outcome = engine.answer((SetWord("grass", -0.5),), 1.1, call=before.observation, call_id=1)
    assert outcome.newest is not None
    assert engine.newest is not None
    again = engine.judge(engine.newest, 1.2)
    assert runs == []
    for seen in (outcome.newest, again):
        assert seen.words["grass"] == -0.5
        assert before.maps is not None
        assert seen.maps is not None
        assert not np.array_equal(seen.maps.signed, before.maps.signed)


def test_a_new_word_runs_text_and_decoder_and_no_tower(tiny: Path, runs: list[str]) -> None:
    engine = engine_of(tiny)
    engine.step(frame(1), 1.0)
    runs.clear()
    outcome = engine.answer((SetWord("mud", 0.5),), 1.1)
    assert runs == [*TEXT, "decoder"]
    assert outcome.newest is not None
    assert outcome.newest.maps is not None
    assert len(outcome.newest.maps.attention) == 3


def test_the_text_networks_are_given_back(tiny: Path, runs: list[str]) -> None:
    engine = engine_of(tiny)
    engine.step(frame(1), 1.0)
    engine.answer((SetWord("mud", 0.5),), 1.1)
    gc.collect()
    held = {Path(one._model_path).stem for one in gc.get_objects() if _is_session(one)}
    assert set(TEXT) <= set(runs)
    assert not held & set(TEXT)
    assert {"image", "decoder", "tail"} <= held


def _is_session(thing: object) -> bool:
    return type(thing) is onnxruntime.InferenceSession


def test_a_word_heard_before_runs_the_decoder_alone(tiny: Path, runs: list[str]) -> None:
    engine = engine_of(tiny)
    engine.step(frame(1), 1.0)
    engine.answer((ForgetWord("rock"),), 1.1)
    engine.step(frame(2), 2.0)
    runs.clear()
    engine.answer((SetWord("rock", 1.0),), 2.1)
    assert runs == ["decoder"]


def test_where_the_scene_is_beyond_doubt_the_tail_is_left_out(tiny: Path, runs: list[str]) -> None:
    engine = engine_of(tiny, scene_every=3)
    for number in range(3):
        engine.step(Frame(number, float(number), frame(1).image), number + 0.1)
    runs.clear()
    for number in range(3, 9):
        engine.step(Frame(number, float(number), frame(1).image), number + 0.1)
    assert [runs.count(part) for part in ("image", "decoder", "tail")] == [6, 6, 2]


def test_a_network_that_fails_is_a_fault_and_the_next_frame_is_judged(
    tiny: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    engine = engine_of(tiny)
    assert Reason.FAULT not in engine.step(frame(1), 1.0).reasons
    with monkeypatch.context() as broken:
        broken.setattr(onnxruntime.InferenceSession, "run", lambda *_: 1 / 0)
        seen = engine.step(frame(2), 2.0)
    assert seen.reasons == {Reason.FAULT}
    (fault,) = seen.findings
    assert "the network failed" in fault.figure
    assert Reason.FAULT not in engine.step(frame(3), 3.0).reasons


@pytest.mark.parametrize(
    "weight",
    [
        "clip.vision_model.encoder.layers.0.layer_norm1.weight",
        "clip.vision_model.encoder.layers.3.layer_norm1.weight",
        "clip.vision_model.post_layernorm.weight",
        "clip.visual_projection.weight",
        "clip.text_projection.weight",
        "clip.text_model.final_layer_norm.bias",
        "decoder.film_mul.weight",
        "decoder.reduces.1.weight",
        "decoder.layers.0.layer_norm1.weight",
        "decoder.transposed_convolution.4.weight",
    ],
)
def test_weights_that_overflow_are_a_fault_never_ok(tmp_path: Path, weight: str) -> None:
    checkpoint = random_clipseg(TINY)
    checkpoint.weights[weight][...] = np.where(checkpoint.weights[weight] < 0, -3e38, 3e38)
    make_bundle(tmp_path / "bundle", checkpoint, size=64)
    engine = engine_of(tmp_path / "bundle")
    for number in range(1, 4):
        seen = engine.step(frame(number), float(number))
        assert Reason.FAULT in seen.reasons
        assert not seen.ok
    assert engine.memory.reference is None
