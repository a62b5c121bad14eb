"""Tells the ground each parameter's value: at once, or once it is in the journal."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from companion.link.link import Link
from companion.wire import notices
from companion.wire.ids import WARNING
from companion.wire.parameters import Parameter

AfterWrite = Callable[[Callable[[bool, float], None]], None]
"""Registers a callback for when this turn's changes are in the journal: see `Persistence.after_write`."""
BUSY = "vision is busy, set it again"
"""Why a value was not set."""


class ParameterEcho:
    """Keeps the values in force, parameter name -> value, which the ground is told."""

    def __init__(self, parameters: Iterable[Parameter], link: Link, after_write: AfterWrite) -> None:
        """parameters: as configured. after_write: registers what must not be sent before it is stored."""
        self.values = {parameter.name: parameter.value for parameter in parameters}
        self.after_write = after_write
        self._link = link

    def send(self, name: str, value: float, now: float) -> None:
        """Echo a value at once."""
        self.values[name] = value
        self._link.parameters.set_value(name, value, now)

    def send_change(self, name: str, value: float, now: float) -> None:
        """Echo a value that changed without a request for it."""
        if value != self.values[name]:
            self.send(name, value, now)

    def send_after_write(self, name: str, value: float, what: str) -> None:
        """Echo a value once it is in the journal. Where it is not, a text says that `what` is not remembered.

        what: "" for no text.
        """
        self.values[name] = value

        def written(stored: bool, now: float) -> None:
            self._link.parameters.set_value(name, value, now)
            if what and not stored:
                self._link.texts.send(notices.not_remembered(what), WARNING, now)

        self.after_write(written)
