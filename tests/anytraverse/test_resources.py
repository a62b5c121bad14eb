from pathlib import Path

import pytest

from anytraverse.resources import resource

ROOT = Path(__file__).resolve().parents[2]


def test_a_checkout_finds_its_files_at_the_root() -> None:
    assert resource("systemd/companion.service") == ROOT / "systemd/companion.service"
    assert resource("config") == ROOT / "config"


@pytest.mark.parametrize("name", ["", "pyproject.toml", "config/../pyproject.toml", "/etc/passwd", "tests"])
def test_a_name_outside_the_shipped_folders_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="config or systemd"):
        resource(name)


def test_a_file_that_is_not_there_says_where_it_was_looked_for() -> None:
    with pytest.raises(FileNotFoundError, match=r"config/no\.toml is not at /.*install"):
        resource("config/no.toml")
