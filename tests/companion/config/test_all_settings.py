"""The pages list every setting of the file, and what is changed there is checked as the file is."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from companion.config import Config, json_schema, load_config
from companion.config.editing import propose
from companion.config.rows import all_settings

TEXT = """vocabulary = ["grass", "mud"]
[vehicle]
file = ""
[words]
grass = 1.0
rock = -0.8
[aliases]
grass = "GR"
[link]
url = "udpin:127.0.0.1:14550"
[link.more.wifi]
url = "udpin:127.0.0.1:14551"
budget = 500.0
[link.more.lte]
url = "udpout:127.0.0.1:14552"
"""


def _keys() -> Iterator[str]:
    for name, part in json_schema()["properties"].items():
        inner = part.get("properties")
        yield from (f"{name}.{one}" for one in inner) if inner else (name,)


def _row(config: Config, key: str) -> dict[str, Any]:
    (found,) = (row for row in all_settings(config, {}) if row["key"] == key)
    return found


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "companion.toml"
    path.write_text(TEXT)
    return path


def test_each_key_of_the_schema_is_a_row_and_no_row_is_none() -> None:
    assert sorted(row["key"] for row in all_settings(Config(), {})) == sorted(_keys())


def _changed(file: Path, key: str, value: object) -> Config:
    proposal = propose(file, {key: value})
    assert proposal.problems == ()
    file.write_text(proposal.after)
    return load_config(file)


def test_words_and_connections_are_shown_as_they_are_given_back(file: Path) -> None:
    config = load_config(file)
    for key in ("words", "vocabulary", "aliases", "link.more"):
        value = _row(config, key)["value"]
        assert value, key
        after = _changed(file, key, value)
        assert (after.words, after.aliases, after.link) == (config.words, config.aliases, config.link)
        assert set(after.vocabulary) == set(config.vocabulary)


def test_words_and_connections_are_replaced_as_a_whole(file: Path) -> None:
    assert _row(load_config(file), "vocabulary")["value"] == ["mud"]
    assert _changed(file, "vocabulary", ["gravel"]).vocabulary == ("grass", "rock", "gravel")
    assert _changed(file, "aliases", {"gravel": "GV"}).aliases == {"gravel": "GV"}
    assert _changed(file, "words", {"gravel": 0.5}).words == {"gravel": 0.5}
    link = _changed(
        file, "link.more", {"wifi.url": "udpin:127.0.0.1:1", "mesh.url": "udpin:127.0.0.1:2"}
    ).link
    assert [(name, one.url, one.budget) for name, one in link.more] == [
        ("wifi", "udpin:127.0.0.1:1", 300.0),
        ("mesh", "udpin:127.0.0.1:2", 300.0),
    ]
    assert _changed(file, "link.more", None).link.more == ()
    assert "[link.more" not in file.read_text()
    assert "udpin:127.0.0.1:14550" in file.read_text()


def test_a_word_that_is_offered_and_in_use_stays_offered_when_the_vocabulary_is_changed(file: Path) -> None:
    row = _row(load_config(file), "vocabulary")["value"]
    _changed(file, "vocabulary", [*row, "log"])
    assert 'vocabulary = ["grass", "mud", "log"]' in file.read_text()
    assert _changed(file, "words", {}).vocabulary == ("grass", "mud", "log")


def test_the_word_of_the_video_is_not_written_with_the_vocabulary(file: Path) -> None:
    file.write_text(TEXT + '[video]\nlisten = "127.0.0.1:8554"\n')
    row = _row(load_config(file), "vocabulary")["value"]
    assert row == ["mud"]
    assert "obstacle" in _changed(file, "vocabulary", row).vocabulary
    assert "obstacle" not in file.read_text()


@pytest.mark.parametrize(
    ("key", "value", "why"),
    [
        ("words", {"grass": 2.0}, "give a number from -1 to 1"),
        ("words", ["grass"], "give a table"),
        ("words", {"Grass": -1, "grass": 1}, "stands twice"),
        ("vocabulary", ["a:b"], "which separate words"),
        ("aliases", {"grass": "far too long a name for a parameter"}, "grass"),
        ("link.more", {"wifi.budget": 5.0}, "needs a url"),
        ("link.more", {"wifi.nonsense": 1}, "is not known"),
        ("link.more", {"url": "udpin:127.0.0.1:1"}, "write link.more.NAME.url"),
        ("link.more", {f"w{n}.url": f"udpin:127.0.0.1:{n + 1}" for n in range(9)}, "more"),
        ("link.more", "wifi", "give a table"),
    ],
)
def test_what_the_check_of_the_file_refuses_is_refused(file: Path, key: str, value: object, why: str) -> None:
    problems = propose(file, {key: value}).problems
    assert problems
    assert any(why in str(one) for one in problems)


def test_where_words_are_guarded_the_rows_say_so(file: Path) -> None:
    assert not _row(load_config(file), "words")["shell"]
    file.write_text(TEXT + '[perceiver]\nname = "clipseg:somewhere"\n')
    for key, typed in (
        ("words", "words.WORD"),
        ("vocabulary", "vocabulary"),
        ("link.more", "link.more.NAME.url"),
    ):
        row = _row(load_config(file), key)
        assert (row["shell"], row["typed"]) == (True, typed)
