import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.storage.served_files import MAX_FILES, MatchingFiles
from companion.storage.served_tree import (
    MAX_SIZE,
    Document,
    Documents,
    FileError,
    ListingEntry,
    MissingError,
    Opened,
    Tree,
)

LARGE = 64 * 1024


def whole(opened: Opened) -> bytes:
    try:
        return opened.read(0, opened.size)
    finally:
        opened.close()


def broken() -> bytes:
    raise KeyError("no such word")


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    folder = tmp_path / "logs"
    folder.mkdir()
    (folder / "one.log").write_bytes(b"first")
    (folder / "two.log").write_bytes(b"second")
    (folder / "note.txt").write_bytes(b"text")
    (folder / ".hidden.log").write_bytes(b"hidden")
    (folder / "deeper.log").mkdir()
    (tmp_path / "secret.log").write_bytes(b"secret")
    (folder / "link.log").symlink_to(tmp_path / "secret.log")
    os.mkfifo(folder / "pipe.log")
    return folder


@pytest.fixture
def tree(logs: Path) -> Tree:
    calls = {"7.json": b"{}", "7.jpg": b"picture"}
    return Tree(
        {
            "state.json": Document(lambda: b'{"words": []}'),
            "calls": Documents(lambda: {name: len(data) for name, data in calls.items()}, calls.__getitem__),
            "logs": MatchingFiles(logs, "*.log"),
        }
    )


def test_the_root_lists_files_and_folders_by_name(tree: Tree) -> None:
    expected = (ListingEntry("calls", None), ListingEntry("logs", None), ListingEntry("state.json", 13))
    assert tree.entries("/") == tree.entries("") == expected


def test_a_folder_lists_only_visible_regular_files_that_match(tree: Tree) -> None:
    assert tree.entries("/logs") == (ListingEntry("one.log", 5), ListingEntry("two.log", 6))
    assert tree.entries("calls/") == (ListingEntry("7.jpg", 7), ListingEntry("7.json", 2))


@pytest.mark.parametrize(
    ("path", "content"),
    [
        ("/state.json", b'{"words": []}'),
        ("state.json", b'{"words": []}'),
        ("/calls/7.jpg", b"picture"),
        ("//logs//one.log", b"first"),
    ],
)
def test_a_file_is_found_with_and_without_slashes(tree: Tree, path: str, content: bytes) -> None:
    assert whole(tree.open(path)) == content


OUTSIDE = [
    "",
    "/",
    "/nothing",
    "/logs",
    "/logs/nothing.log",
    "/logs/note.txt",
    "/logs/.hidden.log",
    "/logs/link.log",
    "/logs/pipe.log",
    "/logs/deeper.log",
    "/logs/deeper.log/x.log",
    "/logs/../secret.log",
    "/../secret.log",
    "../secret.log",
    "/etc/passwd",
    "/state.json/x",
    "/calls/8.json",
    "@PARAM/param.pck",
    "/logs/one.log\n",
    "/logs/\ud800.log",
]


@pytest.mark.parametrize("path", OUTSIDE)
def test_nothing_else_is_there(tree: Tree, path: str) -> None:
    with pytest.raises(MissingError):
        tree.open(path)


@pytest.mark.parametrize(
    "path", ["/nothing", "/state.json", "/logs/..", "/logs/deeper.log", "/.", "/calls/7.jpg"]
)
def test_only_folders_are_listed(tree: Tree, path: str) -> None:
    with pytest.raises(MissingError):
        tree.entries(path)


@given(st.text(max_size=40))
def test_no_path_leads_out_or_raises_anything_else(path: str) -> None:
    served = Tree({"logs": MatchingFiles(Path("/etc"), "*.nothing"), "a": Document(lambda: b"a")})
    try:
        assert whole(served.open(path)) == b"a"
    except MissingError:
        assert path.strip("/") != "a"


def test_a_log_stays_as_it_was_when_it_was_opened(logs: Path) -> None:
    path = logs / "large.log"
    path.write_bytes(b"x" * (LARGE + 1))
    opened = Tree({"logs": MatchingFiles(logs)}).open("/logs/large.log")
    with path.open("ab") as log:
        log.write(b"more")
    assert opened.size == LARGE + 1
    assert opened.read(LARGE, 80) == b"x"
    assert opened.read(LARGE + 1, 80) == b""
    path.write_bytes(b"")
    path.unlink()
    assert opened.read(0, 3) == b"xxx"
    opened.close()
    opened.close()


def test_a_small_file_does_not_change_under_its_reader(logs: Path, tree: Tree) -> None:
    opened = tree.open("/logs/one.log")
    (logs / "one.log").write_bytes(b"other")
    assert whole(opened) == b"first"


def test_a_document_is_made_once_for_a_reader() -> None:
    versions = iter([b"one", b"two", b"three"])
    served = Tree({"state.json": Document(lambda: next(versions))})
    first = served.open("state.json")
    assert whole(served.open("state.json")) == b"two"
    assert whole(first) == b"one"


def test_what_is_too_large_is_refused_with_the_limit(logs: Path) -> None:
    with (logs / "huge.log").open("wb") as huge:
        huge.truncate(MAX_SIZE + 1)
    served = Tree({"logs": MatchingFiles(logs), "big": Document(lambda: bytes(MAX_SIZE + 1))})
    for path in ("/logs/huge.log", "/big"):
        with pytest.raises(FileError, match=str(MAX_SIZE)):
            served.open(path)


def test_a_provider_that_fails_costs_its_own_file_only() -> None:
    served = Tree({"bad": Document(broken), "good": Document(lambda: b"good")})
    assert served.entries("/") == (ListingEntry("bad", 0), ListingEntry("good", 4))
    with pytest.raises(FileError, match="KeyError"):
        served.open("bad")
    assert whole(served.open("good")) == b"good"


def test_a_folder_that_is_not_there_yet_is_no_mistake(tmp_path: Path) -> None:
    served = Tree({"maps": MatchingFiles(tmp_path / "maps")})
    assert served.entries("/") == (ListingEntry("maps", None),)
    with pytest.raises(MissingError):
        served.entries("/maps")
    (tmp_path / "maps").mkdir()
    assert served.entries("/maps") == ()


def test_of_too_many_files_the_newest_are_shown(tmp_path: Path) -> None:
    for number in range(MAX_FILES + 3):
        path = tmp_path / f"{number:04}"
        path.touch()
        os.utime(path, (number, number))
    shown = Tree({"logs": MatchingFiles(tmp_path)}).entries("/logs")
    assert [entry.name for entry in shown] == [f"{number:04}" for number in range(3, MAX_FILES + 3)]


class Vanishing(MatchingFiles):
    """Loses a file between its name's turn and its size's, as when a log is turned over."""

    def _shows(self, name: str) -> bool:
        if name == "one.log":
            (self._path / name).unlink()
        return super()._shows(name)


def test_a_file_that_goes_away_meanwhile_costs_no_other_its_place_in_the_list(logs: Path) -> None:
    assert Tree({"logs": Vanishing(logs, "*.log")}).entries("/logs") == (ListingEntry("two.log", 6),)


@pytest.mark.parametrize("name", ["", ".hidden", "a/b", "a\tb", "x" * 129, "\ud800"])
def test_a_mount_needs_a_name_that_can_be_shown(name: str) -> None:
    with pytest.raises(ValueError, match="cannot be the name"):
        Tree({name: Document(lambda: b"")})


@pytest.fixture
def descriptors() -> Iterator[None]:
    before = os.listdir("/proc/self/fd")
    yield
    assert os.listdir("/proc/self/fd") == before


@pytest.mark.usefixtures("descriptors")
def test_no_descriptor_is_left_behind(tree: Tree, logs: Path) -> None:
    (logs / "large.log").write_bytes(b"x" * (LARGE + 1))
    for path in [*OUTSIDE, "/logs/one.log", "/logs/large.log"]:
        with suppress(FileError):
            tree.open(path).close()
        tree.entries("/logs")
