"""Files that ship beside the code: what a person edits (config) and what boots the daemon (systemd)."""

from pathlib import Path, PurePosixPath

_PACKAGE = Path(__file__).resolve().parent.parent
_FOLDERS = ("config", "systemd")


def resource(name: str) -> Path:
    """The shipped file or folder of this name, e.g. ``config/companion.toml``, ``systemd``.

    Found in an installed wheel (``companion/data``) and in a checkout or editable install (the root).
    Raises ValueError for a name outside config and systemd, FileNotFoundError where nothing is shipped
    under that name.
    """
    parts = PurePosixPath(name).parts
    if not parts or parts[0] not in _FOLDERS or ".." in parts:
        raise ValueError(f"{name!r} is no shipped file: names begin with {' or '.join(_FOLDERS)}")
    path = _root().joinpath(*parts)
    if not path.exists():
        raise FileNotFoundError(f"{name} is not at {path}: install anytraverse-companion again")
    return path


def _root() -> Path:
    # Beside an installed package stands site-packages, where a folder called config may be anybody's.
    checkout = _PACKAGE.parent
    return checkout if (checkout / "pyproject.toml").is_file() else _PACKAGE / "data"
