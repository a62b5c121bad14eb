"""OK needs evidence, whatever the maps, words, weights and thresholds. A danger with a name is one still."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from anytraverse.assessment import Finding, Maps, Observation, Reason
from anytraverse.engine import AnyTraverse
from anytraverse.errors import PreferencesError
from anytraverse.findings import find, make_maps, roi_figures
from anytraverse.frame import Frame
from anytraverse.judging import Settings, Thresholds
from anytraverse.look import read_picture
from anytraverse.memory import first_memory
from anytraverse.perception import Perceiver, make_perceiver
from anytraverse.preferences import Preferences
from anytraverse.regions import Box
from anytraverse.roi import Corridor
from tests.anytraverse.test_corridor_and_sectors import slow_open

Map = NDArray[np.float32]
SHARED = Path(__file__).parents[2].parent / "shared" / "data"
WEIGHTS = (-1.0, -0.5, -0.1, 0.0, 0.05, 0.3, 1.0)
WHOLE = Box(0, 0, 1, 1)


def judged(attention: Map, weights: list[float], judging: Settings) -> tuple[Maps, list[Finding]]:
    """The maps and what is found in them."""
    maps = make_maps(attention, weights, judging)
    assert isinstance(maps, Maps)
    height, width = attention.shape[1:]
    roi = roi_figures(maps, width / height, judging)
    assert not isinstance(roi, Finding)
    return maps, find(roi, len(maps.attention), None, judging)


def reasons(findings: list[Finding]) -> frozenset[Reason]:
    return frozenset(finding.reason for finding in findings if finding.bad)


@st.composite
def scenes(draw: st.DrawFn) -> tuple[Map, list[float], Settings]:
    """Ground of blocks that words explain more or less, around the threshold as well; any thresholds."""
    count, height, width = draw(st.integers(0, 4)), draw(st.integers(1, 14)), draw(st.integers(1, 16))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    levels = np.array([0, 0.1, 0.36, 0.49, 0.5, 0.55, 0.9, 1], dtype=np.float32)
    blocks = rng.choice(levels, (count, -(-height // 4), -(-width // 4)))
    attention = blocks.repeat(4, axis=1).repeat(4, axis=2)[:, :height, :width].copy()
    if count and draw(st.booleans()):
        attention[0] = np.maximum(attention[0], 0.95 - 0.5 * rng.random((height, width)) ** 4)
    stray = rng.random(attention.shape) < 0.03
    attention[stray] = rng.choice(levels, int(stray.sum()))
    weights: list[float] = draw(st.lists(st.sampled_from(WEIGHTS), min_size=count, max_size=count))
    if draw(st.booleans()) and weights:
        weights[0] = 1.0
    limits = Thresholds(
        roi=draw(st.sampled_from([0.05, 0.3, 0.55, 1.0])),
        tile=draw(st.sampled_from([None, 0.25, 0.65, 1.0])),
        trav=draw(st.sampled_from([0.0, 0.4, 1.0])),
    )
    corridor = Corridor(
        *draw(st.sampled_from([(0.3, 0.2), (0.9, 0.4), (0.05, 0.05)])), bottom_row=1.0, top_row=0.0
    )
    return attention, weights, Settings(region=WHOLE, thresholds=limits, corridor=corridor)


@pytest.mark.slow
@given(scenes())
@settings(max_examples=400)
def test_no_frame_is_ok_without_a_corridor_that_is_positively_drivable(
    scene: tuple[Map, list[float], Settings],
) -> None:
    attention, weights, judging = scene
    maps, findings = judged(attention, weights, judging)
    height, width = attention.shape[1:]
    drivable = np.zeros((height, width), dtype=np.bool_)
    for row, column in np.ndindex(height, width):
        by_word = list(zip(weights, attention[:, row, column], strict=True))
        wins = max((w * m for w, m in by_word), default=0) > max((-w * m for w, m in by_word), default=0)
        drivable[row, column] = (
            wins
            and any(w > 0 and m >= 0.5 for w, m in by_word)
            and not any(w <= 0 and m >= 0.5 for w, m in by_word)
        )
    assert (maps.drivable == drivable).all()
    side = min(max(1, round(judging.tile_share * width)), width)
    opened = slow_open(drivable, judging.corridor, (min(side, height), side))
    bad = reasons(findings)
    assert opened or bad & {Reason.UNKNOWN_OBJECT, Reason.BLOCKED}
    (blocked, unknown) = (one for one in findings if one.figure == "corridor")
    assert (blocked.bad or unknown.bad) is not opened
    assert not (blocked.bad and unknown.bad), "uncertainty decides between the two"
    assert opened or not (blocked.clear and unknown.clear)


@pytest.mark.slow
@given(scenes(), st.data())
@settings(max_examples=400)
def test_a_word_that_is_not_drivable_and_a_lower_weight_never_make_a_frame_ok(
    scene: tuple[Map, list[float], Settings], data: st.DataObject
) -> None:
    attention, weights, judging = scene
    _, after = judged(attention, weights, judging)
    if reasons(after) or not weights:
        return
    which = data.draw(st.integers(0, len(weights) - 1))
    if weights[which] <= 0 and data.draw(st.booleans()):
        others = [index for index in range(len(weights)) if index != which]
        _, before = judged(attention[others], [weights[index] for index in others], judging)
    else:
        higher = data.draw(st.floats(weights[which], 1.0))
        _, before = judged(attention, [*weights[:which], higher, *weights[which + 1 :]], judging)
    assert not reasons(before)


def drum_across(explained: float, top: float = 0.4) -> tuple[Map, list[float]]:
    """A trail, and across it a drum with weight -1 that its word explains so far."""
    attention = np.zeros((2, 30, 40), dtype=np.float32)
    attention[0] = 0.95
    attention[0, int(30 * top) : int(30 * top) + 6] = 0.1
    attention[1, int(30 * top) : int(30 * top) + 6] = explained
    return attention, [1.0, -1.0]


@pytest.mark.parametrize("explained", [0.0, 0.1, 0.36, 0.42, 0.49, 0.5, 0.7, 1.0])
def test_there_is_no_dead_band_between_unknown_and_blocked(explained: float) -> None:
    judging = Settings(region=WHOLE, thresholds=Thresholds(roi=0.4, tile=0.65))
    _, findings = judged(*drum_across(explained), judging)
    assert reasons(findings) & {Reason.UNKNOWN_OBJECT, Reason.BLOCKED}
    _, findings = judged(*drum_across(explained), Settings(region=WHOLE, thresholds=Thresholds(roi=1.0)))
    assert reasons(findings) == {Reason.UNKNOWN_OBJECT if explained < 0.2 else Reason.BLOCKED}


def test_a_roi_of_no_traversability_is_not_ok_at_any_threshold() -> None:
    attention = np.full((1, 30, 40), 0.46, dtype=np.float32)
    for weight in WEIGHTS:
        _, findings = judged(attention, [weight], Settings(region=WHOLE, thresholds=Thresholds(roi=0.55)))
        assert reasons(findings) == {Reason.UNKNOWN_OBJECT if weight > 0 else Reason.BLOCKED}


@pytest.mark.parametrize("weight", [-1.0, 0.0])
def test_what_another_word_explains_more_is_still_not_drivable(weight: float) -> None:
    attention = np.stack([np.full((30, 40), 0.95), np.full((30, 40), 0.6)]).astype(np.float32)
    _, findings = judged(attention, [1.0, weight], Settings(region=WHOLE))
    assert reasons(findings) == {Reason.BLOCKED}


def test_a_frame_that_is_not_ok_for_want_of_a_way_points_at_where_it_ends(make_rover: Any) -> None:
    rover = make_rover("grass: 1", Settings(thresholds=Thresholds(roi=1.0)))
    seen = rover.see(thing="drum")
    assert seen.reasons == {Reason.UNKNOWN_OBJECT}
    assert seen.tile is not None
    assert Box(0.4, 0.65, 0.6, 0.9).contains(*seen.tile.box.centre)


class Sharing:
    """Words share out what they explain: a danger's name makes what it is mixed with known, too."""

    def __init__(self, strange: Map) -> None:
        self.strange = strange

    def attend(self, asked: list[str]) -> Map:
        """Attention of the words asked for, (n, h, w)."""
        share = np.where(self.strange > 0.5, 0.9 if "rock" in asked else 0.0, 0.95)
        return np.stack([share * (1.0 if word == "trail" else 0.4) for word in asked]).astype(np.float32)


def test_a_word_that_explains_a_thing_for_the_trails_word_does_not_open_the_way() -> None:
    strange = np.zeros((30, 40), dtype=np.float32)
    strange[12:18] = 1.0
    words, eyes = {"trail": 1.0, "rock": -1.0}, Sharing(strange)
    maps = make_maps(eyes.attend(list(words)), list(words.values()), Settings(), eyes.attend(["trail"]))
    assert isinstance(maps, Maps)
    assert maps.uncertainty.max() < 0.2, "as the paper has it"
    assert not maps.drivable[12:18].any()
    judging = Settings(region=WHOLE, thresholds=Thresholds(roi=0.4, tile=0.65))
    roi = roi_figures(maps, 4 / 3, judging)
    assert not isinstance(roi, Finding)
    assert reasons(find(roi, len(maps.attention), None, judging)) == {Reason.BLOCKED}


def attend(strengths: Map, groups: list[int], asked: list[int]) -> Map:
    """Attention of words that compete: those of one group share out what the strongest of them explains."""
    found = np.zeros((len(asked), *strengths.shape[1:]), dtype=np.float64)
    for group in set(groups):
        rivals = [place for place, word in enumerate(asked) if groups[word] == group]
        if rivals:
            strong = strengths[[asked[place] for place in rivals]].astype(np.float64)
            found[rivals] = strong.max(axis=0) * strong / np.maximum(strong.sum(axis=0), 1e-9)
    return found.astype(np.float32)


@st.composite
def rivalries(draw: st.DrawFn) -> tuple[Map, list[int], list[float], float]:
    """Strengths of words, the groups in which they compete, the weights of all but the last, and the last's.

    The last word is the least drivable one.
    """
    count = draw(st.integers(2, 4))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    levels = np.array([0, 0.1, 0.36, 0.49, 0.5, 0.55, 0.9, 1], dtype=np.float32)
    strengths = rng.choice(levels, (count, 6, 8))
    weights: list[float] = draw(st.lists(st.sampled_from(WEIGHTS), min_size=count - 1, max_size=count - 1))
    groups = draw(st.lists(st.integers(0, 1), min_size=count, max_size=count))
    return strengths, groups, weights, draw(st.sampled_from([w for w in WEIGHTS if w <= min(0.0, *weights)]))


@pytest.mark.parametrize("spoilt", [np.nan, 2.0])
def test_spoilt_attention_of_the_drivable_words_alone_is_a_fault_too(spoilt: float) -> None:
    whole, alone = np.full((1, 4, 4), 0.5, np.float32), np.full((1, 4, 4), spoilt, np.float32)
    found = make_maps(whole, [1.0], Settings(), alone)
    assert isinstance(found, Finding)
    assert found.reason is Reason.FAULT


@pytest.mark.slow
@given(rivalries())
@settings(max_examples=400)
def test_a_further_word_that_is_not_drivable_makes_no_ground_drivable_where_words_compete(
    rivals: tuple[Map, list[int], list[float], float],
) -> None:
    strengths, groups, weights, last = rivals
    drivable = []
    for words in (weights, [*weights, last]):
        asked = list(range(len(words)))
        alone = attend(strengths, groups, [word for word in asked if words[word] > 0])
        maps = make_maps(attend(strengths, groups, asked), words, Settings(), alone)
        assert isinstance(maps, Maps)
        drivable.append(maps.drivable)
    before, after = drivable
    assert not (after & ~before).any()


def test_a_further_name_of_a_danger_makes_no_larger_share_drivable_where_words_compete() -> None:
    strengths = np.full((3, 30, 40), 0.55, dtype=np.float32)
    strengths[0, :, 12:] = 0.45
    strengths[0, :, :12], strengths[1:, :, :12] = 1.0, 0.0
    judging = Settings(region=WHOLE, thresholds=Thresholds(roi=0.55, trav=0.4))
    shares = []
    for words in ([1.0, -1.0], [1.0, -1.0, -1.0]):
        asked = list(range(len(words)))
        whole, alone = attend(strengths, [0, 1, 1], asked), attend(strengths, [0, 1, 1], [0])
        maps = make_maps(whole, words, judging, alone)
        assert isinstance(maps, Maps)
        roi = roi_figures(maps, 4 / 3, judging)
        assert not isinstance(roi, Finding)
        shares.append(roi.drivable_share)
    assert shares == [0.3, 0.3]


@cache
def seen_by_builtin() -> tuple[Perceiver, list[Observation]]:
    """Real frames of several robots and countries, seen once."""
    perceiver = make_perceiver("builtin")
    paths = [
        *sorted((SHARED / "frames").glob("*.[jp]*g")),
        *sorted((SHARED / "sequence").glob("*.[jp]*g")),
        *sorted((SHARED / "abroad").glob("*/*.jpg"))[::4],
        *sorted((SHARED / "trail").glob("*.jpg"))[::40],
    ]
    frames = [Frame(number, 0.0, read_picture(str(path))) for number, path in enumerate(paths)]
    embedding = np.ones(32, dtype=np.float32)
    return perceiver, [Observation(frame, perceiver.encode(frame.image), embedding) for frame in frames]


def ok(perceiver: Perceiver, seen: Observation, words: Mapping[str, float]) -> bool:
    judging = Settings(thresholds=Thresholds.of(perceiver.defaults))
    engine = AnyTraverse(perceiver, judging, first_memory(perceiver.model_id, Preferences.of(words)))
    return engine.judge(seen, 0.0).ok


@pytest.mark.slow
@pytest.mark.skipif(not SHARED.is_dir(), reason="the development frames ../shared/data are absent")
def test_naming_a_danger_never_makes_a_real_frame_ok() -> None:
    perceiver, frames = seen_by_builtin()
    rng = np.random.default_rng(6)
    vocabulary = ["trail", "dirt", "gravel", "road", "mud", "sand", "grass", "dry grass", "bush", "tree"]
    vocabulary += ["vegetation", "water", "sky", "obstacle", "rock", "log"]
    fine = 0
    for seen in frames:
        tried = 0
        while tried < 12:
            chosen = rng.permutation(vocabulary[2:])[: rng.integers(1, 6)]
            before = {"trail": 1.0, "grass": 1.0} | {str(word): float(rng.choice(WEIGHTS)) for word in chosen}
            after = dict(before)
            word = str(rng.choice(vocabulary))
            after[word] = float(rng.choice([w for w in WEIGHTS if w <= min(before.get(word, 0.0), 0.3)]))
            try:
                now, then = ok(perceiver, seen, after), ok(perceiver, seen, before)
            except PreferencesError:  # two words of one meaning
                continue
            tried += 1
            fine += now
            assert then or not now, f"frame {seen.frame.id}: {before} and then {word} {after[word]}"
    assert fine > 50, "frames that are never OK prove nothing"


@pytest.mark.slow
@pytest.mark.skipif(not SHARED.is_dir(), reason="the development frames ../shared/data are absent")
@pytest.mark.parametrize("danger", ["rock", "obstacle", "log", "water"])
def test_on_real_frames_a_danger_by_name_hides_nothing_that_was_noticed(danger: str) -> None:
    perceiver, frames = seen_by_builtin()
    words = {"trail": 1.0, "dirt": 1.0, "grass": 1.0, "bush": -1.0}
    noticed = [seen for seen in frames if not ok(perceiver, seen, words)]
    assert len(noticed) > 5
    assert not any(ok(perceiver, seen, words | {danger: -1.0}) for seen in noticed)
