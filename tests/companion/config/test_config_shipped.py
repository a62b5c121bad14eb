"""The shipped configuration tells the truth: every setting stands in it, with its default."""

from __future__ import annotations

import re
from dataclasses import MISSING, fields, replace
from pathlib import Path

from anytraverse.perception import make_perceiver
from anytraverse.resources import resource
from companion.config import format_config, load_config
from companion.config.schema import SECTIONS


def _write(folder: Path, text: str, vehicle: str = "") -> Path:
    path = folder / "companion.toml"
    path.write_text(text.replace("\ncalibration = ", "\n# calibration = "))  # there is no such file
    (folder / "vehicles").mkdir(exist_ok=True)
    (folder / "vehicles/rover.toml").write_text(vehicle)
    return path


def test_the_shipped_files_load() -> None:
    config = load_config(resource("config/companion.toml"))
    assert config.call.policy == "report"
    assert (config.roi.left, config.roi.top, config.roi.right, config.roi.bottom) == (0.333, 0.6, 0.667, 0.95)
    assert -1.0 in config.words.values()
    assert 1.0 in config.words.values()


def test_the_shipped_words_are_known_to_the_built_in_perceiver() -> None:
    shipped = load_config(resource("config/companion.toml"))
    builtin = make_perceiver(shipped.perceiver.name)
    for word in shipped.vocabulary:
        builtin.meaning(word)


def _uncommented() -> str:
    """The shipped file with every default in force; `vocabulary` goes to the top, where it belongs."""
    lines = resource("config/companion.toml").read_text().splitlines()
    lines = [re.sub(r'^# (\[\w+\]$|[\w"][\w ]*"? = \S.*$)', r"\1", line) for line in lines]
    return "\n".join(sorted(lines, key=lambda line: not line.startswith("vocabulary")))


def test_every_setting_stands_in_the_shipped_file_with_its_default(tmp_path: Path) -> None:
    path = _write(tmp_path, _uncommented(), "")
    config = load_config(path)
    assert config.words
    assert config.vocabulary
    assert config.aliases
    text = _uncommented()
    for name, section in SECTIONS.items():
        body = re.split(r"^\[", text.split(f"\n[{name}]\n")[1], flags=re.MULTILINE)[0]
        for field in fields(section):
            written = rf"^# +\[{name}\.{field.name}\." if field.metadata["tables"] else rf"^{field.name} = "
            assert re.search(written, body, re.MULTILINE), f"{name}.{field.name} is not documented"
            assert field.default is not MISSING
            if field.default is not None:
                assert getattr(getattr(config, name), field.name) == field.default


def test_what_is_printed_loads_as_the_same_configuration(tmp_path: Path) -> None:
    path = _write(tmp_path, _uncommented(), '[words]\n"a\\"\\\\b" = 1\n')
    for config in (load_config(path), load_config(resource("config/companion.toml"))):
        again = load_config(_write(tmp_path, format_config(config)))
        assert replace(again, vehicle=config.vehicle) == config
