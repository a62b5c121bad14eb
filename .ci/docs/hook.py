"""Hook of MkDocs: makes README.md the first page, and copies the files outside of docs/ that pages name."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files, InclusionLevel

ROOT = Path(__file__).resolve().parents[2]
COPIES = "repository"
_LINK = re.compile(r"\]\((?!https?:)([^)\s#]+)")
_FOLDER_LINK = re.compile(r"\[([^]]*)\]\(([^)\s#]+)\)")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds index.md, and each file outside of docs/ that a page names in a link."""
    sources = {page.src_uri: page.content_string for page in files.documentation_pages()}
    sources["index.md"] = (ROOT / "README.md").read_text(encoding="utf-8")
    files.append(File.generated(config, "index.md", content=sources["index.md"]))
    linked = {_in_repository(uri, link) for uri, text in sources.items() for link in _LINK.findall(text)}
    for path in sorted(one for one in linked if not one.startswith("docs/") and (ROOT / one).is_file()):
        copy = File.generated(
            config, f"{COPIES}/{path}", abs_src_path=str(ROOT / path), inclusion=InclusionLevel.NOT_IN_NAV
        )
        files.append(copy)
    return files


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Points links at the copies. Those to folders become plain text, since a site shows no folder."""
    uri = page.file.src_uri

    def pointed(match: re.Match[str]) -> str:
        path = _in_repository(uri, match[1])
        there = path.removeprefix("docs/") if path.startswith("docs/") else f"{COPIES}/{path}"
        return f"]({os.path.relpath(there, os.path.dirname(uri) or '.')}"

    def named(match: re.Match[str]) -> str:
        folder = not match[2].startswith("http") and (ROOT / _in_repository(uri, match[2])).is_dir()
        return match[1] if folder else match[0]

    return _LINK.sub(pointed, _FOLDER_LINK.sub(named, markdown))


def _in_repository(uri: str, link: str) -> str:
    """Returns the path below the repository's root that a page's link means."""
    if uri == "index.md":
        base = ROOT
    elif uri.startswith(f"{COPIES}/"):
        base = (ROOT / uri.removeprefix(f"{COPIES}/")).parent
    else:
        base = ROOT / "docs"
    path = (base / link).resolve()
    return path.relative_to(ROOT).as_posix() if path.is_relative_to(ROOT) else link
