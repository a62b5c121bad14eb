"""classes.json, and which classes a word stands for."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from anytraverse.errors import PreferencesError, UnknownWordError
from anytraverse.evaluation.defaults import usual_classes
from anytraverse.evaluation.labels import DatasetError, LabelClasses, fold, read_classes
from anytraverse.evaluation.matching import NAMED, NONE, USUAL, match_words, parse_matches, refuse_asked, told

CLASSES = LabelClasses(("void", "Dirt_Path", "grass", "water", "rock-bed"), ignore=0)


def meaning(word: str) -> str:
    """Water and puddles are one; rock beds are unheard of."""
    if word == "rock bed":
        raise UnknownWordError(word, ())
    return {"puddle": "water"}.get(word, word)


def test_classes_are_read_as_the_data_sets_write_them(tmp_path: Path) -> None:
    (tmp_path / "classes.json").write_text('{\n "ignore": 254,\n "classes": ["grass", "sky"]\n}')
    assert read_classes(tmp_path) == LabelClasses(("grass", "sky"), 254)
    (tmp_path / "classes.json").write_text('{"classes": ["grass"]}')
    assert read_classes(tmp_path).ignore == 255


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("{", "not JSON"),
        ("[" * 100_000, "not JSON"),
        (" " * 1_000_001, "not JSON"),
        ("\xff", "not JSON"),
        ('["grass"]', 'under "classes"'),
        ('{"classes": {"grass": 0}}', 'under "classes"'),
        ('{"classes": ["grass", 3]}', 'under "classes"'),
        ('{"classes": []}', "names 0 classes"),
        (json.dumps({"classes": ["a"] * 257}), "names 257 classes"),
        ('{"classes": ["grass"], "ignore": "sky"}', '"ignore"'),
        ('{"classes": ["grass"], "ignore": true}', '"ignore"'),
        ('{"classes": ["grass"], "ignore": 256}', '"ignore"'),
    ],
)
def test_classes_that_are_none_are_refused_with_the_form(tmp_path: Path, text: str, why: str) -> None:
    (tmp_path / "classes.json").write_text(text, encoding="latin-1")
    with pytest.raises(DatasetError, match=why) as refused:
        read_classes(tmp_path)
    assert "classes.json" in str(refused.value)


def test_missing_classes_tell_what_to_write(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r'classes.json is missing: write \{"ignore": 255'):
        read_classes(tmp_path)


def test_classes_are_chosen_in_any_spelling() -> None:
    assert CLASSES.choose(["dirt path", " GRASS", "dirt-path", ""]) == ("Dirt_Path", "grass")
    assert fold(" Rock-Bed_2 ") == "rock bed 2"


@pytest.mark.parametrize("name", ["mud", "void"])
def test_a_class_that_is_none_or_is_ignored_is_refused_with_those_there_are(name: str) -> None:
    with pytest.raises(DatasetError, match=f'"{name}" is not a class .*Dirt_Path, grass, water, rock-bed$'):
        CLASSES.choose(["grass", name])


def test_no_class_at_all_is_refused() -> None:
    with pytest.raises(DatasetError, match="no class is named"):
        CLASSES.choose(["", " "])


def test_pixels_of_classes_are_found_and_what_is_ignored_is_not() -> None:
    labels = np.array([[0, 1, 2, 255]], dtype=np.uint8)
    assert CLASSES.mask(labels, ["Dirt_Path", "water"]).tolist() == [[False, True, False, False]]
    assert CLASSES.labelled(labels).tolist() == [[False, True, True, True]]
    assert CLASSES.stray(labels) == 255
    assert CLASSES.stray(labels[:, :3]) is None


def test_classes_of_one_name_count_as_one() -> None:
    classes = LabelClasses(("unused", "grass", "unused", "Grass"))
    assert classes.choose(["grass"]) == ("grass",)
    assert classes.mask(np.array([[0, 1, 2, 3]], dtype=np.uint8), ["grass"]).tolist() == [
        [False, True, False, True]
    ]


def found(words: list[str], classes: LabelClasses, given: str = "") -> dict[str, tuple[str, ...]]:
    usual = {"bush": ("low vegetation",), "tree": ("high vegetation",)}
    matches = match_words(words, classes, meaning, parse_matches(given), usual)
    return {word: one.classes for word, one in matches.items()}


def test_words_find_the_classes_of_their_name_and_of_their_meaning() -> None:
    assert found(["dirt path", "puddle", "sky", "rock bed"], CLASSES) == {
        "dirt path": ("Dirt_Path",),
        "puddle": ("water",),
        "sky": (),
        "rock bed": ("rock-bed",),
    }


def test_a_word_without_a_class_has_those_of_its_kind_that_no_other_word_has() -> None:
    classes = LabelClasses(("smooth_trail", "Rough-Trail", "dirt path", "dry grass", "sky"))
    assert found(["trail", "grass", "dry grass", "sky"], classes) == {
        "trail": ("smooth_trail", "Rough-Trail"),
        "grass": (),
        "dry grass": ("dry grass",),
        "sky": ("sky",),
    }
    assert found(["trail", "sky"], classes, "sky=smooth_trail")["trail"] == ("Rough-Trail",)


def test_a_class_that_names_several_things_belongs_to_a_word_for_any_of_them() -> None:
    classes = LabelClasses(("bush/shrub", "trees", "gravel or sand", "picnic-table", "floor (mud)"))
    assert found(["bush", "tree", "sand", "table", "mud", "picnic"], classes) == {
        "bush": ("bush/shrub",),
        "tree": ("trees",),
        "sand": ("gravel or sand",),
        "table": ("picnic-table",),
        "mud": ("floor (mud)",),
        "picnic": (),
    }


def test_a_word_that_labels_nothing_gets_the_usual_class_and_that_is_told() -> None:
    classes = LabelClasses(("low_vegetation", "high_vegetation", "trail", "sky"))
    usual = usual_classes()
    matches = match_words(["bush", "tree", "trail", "rock"], classes, meaning, {}, usual)
    assert matches["bush"] == (("low_vegetation",), USUAL)
    assert matches["tree"] == (("high_vegetation",), USUAL)
    assert matches["trail"] == (("trail",), NAMED)
    assert matches["rock"] == ((), NONE)
    said = told({word: one._asdict() for word, one in matches.items()})
    assert said.startswith("bush = low_vegetation; tree = high_vegetation; trail = trail; rock = no class ")
    assert '--match "bush=low_vegetation,tree=high_vegetation"' in said


def test_the_operators_own_match_wins_and_a_usual_class_is_nobody_elses() -> None:
    classes = LabelClasses(("low_vegetation", "high_vegetation", "bush", "sky"))
    assert found(["bush", "tree"], classes, "tree=low_vegetation") == {
        "bush": ("bush",),
        "tree": ("low_vegetation",),
    }
    assert found(["tree", "sky"], classes, "sky=high_vegetation")["tree"] == ()
    assert found(["vegetation", "tree"], classes) == {
        "vegetation": ("low_vegetation", "high_vegetation"),
        "tree": (),
    }


def test_a_given_match_stands_in_place_of_what_would_be_found() -> None:
    given = "Grass = dirt_path, grass=rock bed,,puddle=water"
    assert found(["grass", "puddle"], CLASSES, given) == {
        "grass": ("Dirt_Path", "rock-bed"),
        "puddle": ("water",),
    }


@pytest.mark.parametrize(
    ("text", "why"), [("trail", "write word=class"), ("trail=", "write word=class"), ("=grass", "empty")]
)
def test_a_match_that_is_none_is_refused(text: str, why: str) -> None:
    with pytest.raises((DatasetError, PreferencesError), match=why):
        parse_matches(text)


@pytest.mark.parametrize(
    ("text", "why"), [("sky=grass", '"sky" is matched but not'), ("grass=mud", '"mud" is')]
)
def test_a_match_of_what_is_not_there_is_refused(text: str, why: str) -> None:
    with pytest.raises(DatasetError, match=why):
        match_words(["grass"], CLASSES, meaning, parse_matches(text), {})


@pytest.mark.parametrize(("word", "name"), [("puddle", "water"), ("rock bed", "rock-bed")])
def test_a_word_for_what_shall_be_unknown_is_refused_with_the_reason(word: str, name: str) -> None:
    with pytest.raises(PreferencesError, match=f'"{word}" asks for "{name}", which shall be unknown'):
        refuse_asked(["grass", word], ["Dirt_Path", name], meaning)


def test_words_for_other_things_are_not_refused() -> None:
    refuse_asked(["grass", "sky"], ["water", "rock-bed"], meaning)
