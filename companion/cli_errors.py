"""What the commands tell a person: errors to mend, in a line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from anytraverse.errors import file_error


class UserError(Exception):
    """An error that the user of the command can mend. Its text is printed, without a traceback."""


@contextmanager
def told(*kinds: type[Exception]) -> Iterator[None]:
    """Turn errors of these kinds, and those of the configuration, into a `UserError`."""
    from companion.config import ConfigError

    try:
        yield
    except ConfigError as error:
        raise UserError(error_text(error)) from error
    except kinds as error:
        raise UserError(error_text(error)) from error


def error_text(error: Exception) -> str:
    """Return an error's text; several lines begin on one of their own. A file's error has no number."""
    text = file_error(error) if isinstance(error, OSError) and error.filename is not None else str(error)
    return text if "\n" not in text else f"\n{text}"
