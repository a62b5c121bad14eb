"""The modules of all pages fit each other: what one imports, another exports. No browser is needed."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
SHARED = ROOT / "companion" / "pages" / "static"
PAGES = [
    ROOT / place / "static"
    for place in (
        "companion/observers/page",
        "gcs_plugin/console",
        "companion/desk/drives",
        "companion/desk/setup",
    )
]
_EXPORT = re.compile(r"^export (?:async )?(?:function|class|const) (\w+)", re.MULTILINE)
_NAMED = re.compile(r'^import \{([^}]*)\} from "\./([\w.]+)";', re.MULTILINE)
_WHOLE = re.compile(r'^import \* as (\w+) from "\./([\w.]+)";', re.MULTILINE)


def modules(page: Path) -> dict[str, str]:
    """Name and text of each module that a page is served with."""
    return {file.name: file.read_text() for folder in (SHARED, page) for file in folder.glob("*.js")}


@pytest.mark.parametrize("page", PAGES, ids=["rover", "console", "rehearsal", "setup"])
def test_what_a_module_imports_is_exported(page: Path) -> None:
    found = modules(page)
    exported = {name: set(_EXPORT.findall(text)) for name, text in found.items()}
    for name, text in found.items():
        assert text.count("\nimport ") + text.startswith("import ") == sum(
            len(pattern.findall(text)) for pattern in (_NAMED, _WHOLE)
        ), name
        for names, source in _NAMED.findall(text):
            assert {one.strip() for one in names.split(",")} - {""} <= exported[source], (name, source)
        for alias, source in _WHOLE.findall(text):
            assert set(re.findall(rf"\b{alias}\.(\w+)\(", text)) <= exported[source], (name, source)


@pytest.mark.parametrize("page", PAGES, ids=["rover", "console", "rehearsal", "setup"])
def test_a_page_has_no_file_of_the_name_of_a_shared_one_and_loads_all_its_own(page: Path) -> None:
    assert {file.name for file in page.iterdir()}.isdisjoint(file.name for file in SHARED.iterdir())
    site = pytest.importorskip("companion.pages.site")
    index = site.HEAD.decode() + (page / "index.html").read_text() + site.FOOT.decode()
    assert 'src="/main.js"' in index
    for style in ("/look.css", "/style.css"):
        assert f'href="{style}"' in index
    used = {
        source
        for text in modules(page).values()
        for _, source in (*_NAMED.findall(text), *_WHOLE.findall(text))
    }
    assert used | {"main.js"} >= {file.name for file in page.glob("*.js")}


@pytest.mark.parametrize("page", PAGES, ids=["rover", "console", "rehearsal", "setup"])
def test_what_is_told_is_never_markup(page: Path) -> None:
    for name, text in modules(page).items():
        for word in ("innerHTML", "outerHTML", "insertAdjacentHTML", "document.write", "eval("):
            assert word not in text, name


@pytest.mark.parametrize("page", PAGES, ids=["rover", "console", "rehearsal", "setup"])
def test_a_page_stays_small_enough_for_a_slow_link(page: Path) -> None:
    assert sum(file.stat().st_size for folder in (SHARED, page) for file in folder.iterdir()) < 200_000
