"""Finds the files that ship with the code: those that a person edits (config), and the systemd unit."""

from pathlib import Path, PurePosixPath

_PARENT = Path(__file__).resolve().parent.parent
_FOLDERS = ("config", "systemd")


def resource(name: str) -> Path:
    """Return the path of a shipped file or folder, e.g. ``config/companion.toml``, ``systemd``.

    Found in an installed wheel (``companion/data``) and in a checkout or editable install (the root).
    Raises ValueError for a name outside config and systemd, FileNotFoundError where nothing is shipped
    under that name.
    """
    parts = PurePosixPath(name).parts
    if not parts or parts[0] not in _FOLDERS or ".." in parts:
        raise ValueError(f"{name!r} is not a shipped file: names begin with {' or '.join(_FOLDERS)}")
    path = _root().joinpath(*parts)
    if not path.exists():
        raise FileNotFoundError(f"{name} is not at {path}: install anytraverse-companion again")
    return path


def _root() -> Path:
    # The parent of an installed package is site-packages. A folder `config` there may belong to any other
    # package, so the parent counts only where a pyproject.toml shows that it is our checkout.
    return _PARENT if (_PARENT / "pyproject.toml").is_file() else _PARENT / "companion" / "data"
