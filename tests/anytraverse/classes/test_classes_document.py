"""docs/classes.md says what the program does."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from anytraverse.bundle.class_names import read_class_names
from anytraverse.bundle.from_network import add_arguments
from anytraverse.perception.classes.details import ACTIVATIONS, ClassesDetails, InputForm, as_json
from anytraverse.perception.classes.words import ClassWords, NamedClass

TEXT = (Path(__file__).resolve().parents[3] / "docs/classes.md").read_text(encoding="utf-8")


def test_the_names_of_the_example_are_read_as_the_example_says(tmp_path: Path) -> None:
    blocks = re.findall(r"^```\w*\n(.*?)^```", TEXT, re.DOTALL | re.MULTILINE)
    (block,) = (each for each in blocks if each.startswith("# name"))
    (tmp_path / "trails.txt").write_text(block, encoding="utf-8")
    words = read_class_names(tmp_path / "trails.txt")
    assert f"words       {', '.join(words.names)} (1 ignored)" in TEXT
    assert words.classes[words.index("dirt path")].name == "trail"


def test_every_option_that_the_page_names_is_one() -> None:
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    known = set(parser.format_help().replace(",", " ").split())
    named = set(re.findall(r"(--[a-z]+)", TEXT)) - {"--perceiver", "--prompts", "--out"}
    assert len(named) >= 8
    assert {name for name in named if name not in known and f"[{name}" not in known} == set()


def test_every_activation_and_field_is_explained() -> None:
    details = ClassesDetails(ClassWords([NamedClass("a"), NamedClass("b")]), "softmax", InputForm(), "scores")
    for name in (*ACTIVATIONS, *(f"details.{field}" for field in as_json(details))):
        assert f"`{name}`" in TEXT
