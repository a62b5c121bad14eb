"""The rooms of companion/: imports run one way, in the order of the table in docs/architecture.md.

Besides, each class of the product has a name of its own.
"""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from bench.house import circles, imports, rooms_of

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "architecture.md").read_text()


def _rows() -> list[list[str]]:
    table = PAGE.partition("## The rooms of companion/")[2].partition("\n## ")[0]
    rows = [line.split("|")[1] for line in table.splitlines() if line.startswith("| `")]
    return [re.findall(r"`(\w+)/`", row) for row in rows]


def test_every_room_stands_in_the_table() -> None:
    rooms = {path.name for path in (ROOT / "companion").iterdir() if (path / "__init__.py").exists()}
    assert sorted(name for row in _rows() for name in row) == sorted(rooms)


def test_a_room_imports_only_rooms_above_it() -> None:
    above: set[str] = set()
    imported = rooms_of(imports())
    for row in _rows():
        for room in row:
            assert imported.get(room, set()) <= above, room
        above |= set(row)


def test_no_room_and_no_module_imports_one_that_imports_it_back() -> None:
    modules = imports()
    assert circles(rooms_of(modules)) == []
    assert circles(modules) == []


def test_every_file_that_the_page_names_is_there() -> None:
    named = set(re.findall(r"`([a-z_]+/[a-z_/]*[a-z_](?:\.py)?)`", PAGE))
    assert len(named) > 30
    for name in named:
        places = [ROOT / name, ROOT / "companion" / name, ROOT / "anytraverse" / name]
        assert any(p.exists() or p.with_suffix(".py").exists() for p in places), name


def _classes() -> Iterator[str]:
    """Yield the public classes of the product's modules, without the simulation's."""
    for package in ("anytraverse", "companion", "gcs_plugin"):
        for path in (ROOT / package).rglob("*.py"):
            if not path.is_relative_to(ROOT / "companion" / "sim"):
                body = ast.parse(path.read_text()).body
                yield from (one.name for one in body if isinstance(one, ast.ClassDef) and one.name[0] != "_")


def test_no_two_public_classes_of_the_product_share_a_name() -> None:
    classes = Counter(_classes())
    assert len(classes) > 500
    assert [name for name, places in classes.items() if places > 1] == []
