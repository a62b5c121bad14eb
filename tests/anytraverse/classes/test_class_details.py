"""What a classes bundle's manifest says: written, read again, and refused where it is unfit."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.errors import BundleError
from anytraverse.perception.classes.details import (
    DTYPES,
    LAYOUTS,
    ORDERS,
    ClassesDetails,
    InputForm,
    as_json,
    read_details,
)
from anytraverse.perception.classes.words import ClassWords, NamedClass

NUMBERS = st.floats(0.001, 300.0)
TRIPLES = st.tuples(NUMBERS, NUMBERS, NUMBERS)
FORMS = st.builds(
    InputForm,
    st.sampled_from(LAYOUTS),
    st.sampled_from(DTYPES),
    st.sampled_from(ORDERS),
    NUMBERS,
    TRIPLES,
    TRIPLES,
)
PICTURE = np.arange(2 * 4 * 3, dtype=np.uint8).reshape(2, 4, 3)


def values() -> dict[str, Any]:
    classes = [NamedClass("grass", ("lawn",)), NamedClass("void", (), is_word=False)]
    return as_json(ClassesDetails(ClassWords(classes), "softmax", InputForm(), "scores"))


@settings(max_examples=40)
@given(form=FORMS, activation=st.sampled_from(["softmax", "probabilities", "sigmoid", "none"]))
def test_what_is_written_is_read_again(form: InputForm, activation: str) -> None:
    classes = [
        NamedClass("grass", ("lawn", "green grass")),
        NamedClass("ödland"),
        NamedClass("void", (), is_word=False),
    ]
    details = ClassesDetails(ClassWords(classes), activation, form, "scores")
    again = read_details(json.loads(json.dumps(as_json(details))), "details")
    assert again.words.classes == details.words.classes
    assert (again.activation, again.form, again.output) == (activation, form, "scores")


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        (("colour",), 1, "unknown field"),
        (("classes",), {}, "a list"),
        (("classes", 0, "name"), "Grass", 'write "Grass" as "grass"'),
        (("classes", 0, "name"), "a;b", "class 0"),
        (("classes", 0, "synonyms"), ["void"], "stands twice"),
        (("classes", 0, "weight"), 1, "unknown field"),
        (("ignore",), ["rock"], "names of classes"),
        (("ignore",), ["grass", "void"], "no class is a word"),
        (("activation",), "relu", "one of softmax"),
        (("output",), "", "one line of text"),
        (("input", "layout"), "hwc", "nchw"),
        (("input", "mean"), [0, 0], "three numbers"),
        (("input", "mean"), [0, 0, None], "a number"),
        (("input", "std"), [1, 0, 1], "above 0"),
        (("input", "scale"), True, "a number"),
    ],
)
def test_details_that_are_unfit_are_refused(path: tuple[Any, ...], value: object, said: str) -> None:
    changed = values()
    place: Any = changed
    for step in path[:-1]:
        place = place[step]
    place[path[-1]] = value
    with pytest.raises(BundleError, match=said) as refused:
        read_details(changed, "manifest.json: details")
    assert str(refused.value).count("manifest.json") == 1


def test_one_class_cannot_have_a_softmax() -> None:
    with pytest.raises(BundleError, match="sigmoid or none"):
        ClassesDetails(ClassWords([NamedClass("grass")]), "softmax", InputForm(), "scores")


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("order", ORDERS)
def test_pixels_are_normalised_channel_by_channel(layout: str, order: str) -> None:
    mean, std = np.array([0.4, 0.5, 0.6]), np.array([0.1, 0.2, 0.3])
    form = InputForm(layout, "float32", order, 1 / 255, (0.4, 0.5, 0.6), (0.1, 0.2, 0.3))
    pixels = PICTURE if order == "rgb" else PICTURE[..., ::-1]
    expected = (pixels / 255 - mean) / std
    tensor = form.tensor(PICTURE)
    assert tensor.dtype == np.float32
    assert tensor.flags.c_contiguous
    np.testing.assert_allclose(
        tensor[0].transpose(1, 2, 0) if layout == "nchw" else tensor[0], expected, rtol=1e-5
    )


def test_bytes_stay_as_they_are() -> None:
    form = InputForm("nchw", "uint8", "bgr", 1 / 255, (0.4, 0.5, 0.6), (0.1, 0.2, 0.3))
    np.testing.assert_array_equal(form.tensor(PICTURE)[0].transpose(1, 2, 0), PICTURE[..., ::-1])
