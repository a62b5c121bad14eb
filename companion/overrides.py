"""What the ground set, beside the value that the configuration had then. Pure.

After a restart it counts again, unless the owner has edited that value since: the file is the owner's.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from anytraverse.errors import SettingsError
from anytraverse.judging import Settings
from companion.tuning import OF_THE_PERCEIVER, judging_values, tuned
from companion.wire.parameters import Parameter, build


class Overrides:
    """Parameter name -> value, for what differs from the configured one."""

    def __init__(self, configured: Mapping[str, float], model_id: str) -> None:
        """configured: of every parameter that is kept. model_id: whom the thresholds are for."""
        self.configured = {name: round(value, 6) for name, value in configured.items()}
        self._model_id = model_id
        self._set: dict[str, float] = {}

    @property
    def values(self) -> Mapping[str, float]:
        """What counts instead of the configured values."""
        return dict(self._set)

    def set(self, name: str, value: float) -> None:
        """The ground set it; back at the configured value, it is none of ours any more."""
        if value == self.configured[name]:
            self._set.pop(name, None)
        else:
            self._set[name] = value

    def drop(self, *names: str) -> None:
        """These are as configured again."""
        for name in names:
            self._set.pop(name, None)

    def tuned(self, judging: Settings) -> tuple[Settings, list[str]]:
        """`judging` with them, and what a person should be told of those that do not fit it: they go."""
        try:
            return tuned(judging, self._set), []
        except SettingsError as error:
            gone = [name for name in self._set if name in judging_values(judging)]
            self.drop(*gone)
            return judging, [f"{', '.join(gone)} as configured: {error}"]

    def saved(self) -> dict[str, Any]:
        """For the journal: JSON values."""
        values = {name: [value, self.configured[name]] for name, value in self._set.items()}
        return {"model": self._model_id, "values": values}

    def figures(self) -> dict[str, Any]:
        """For the status file: what differs from the configuration."""
        return {
            name: {"set": value, "configured": self.configured[name]} for name, value in self._set.items()
        }

    def restore(self, saved: Any) -> list[str]:
        """Take what `saved` made; what a person should be told of what was left out. Nonsense is left out."""
        if saved is None:
            return []
        if not isinstance(saved, Mapping) or not isinstance(saved.get("values"), Mapping):
            return ["settings of the ground could not be read: as configured"]
        allowed = {parameter.name: parameter for parameter in build((), {}, {})}
        edited, strange, corrupt = [], [], []
        for name, row in saved["values"].items():
            read = _read(allowed.get(name), row) if name in self.configured else None
            if read is None:
                corrupt.append(str(name))
            elif name in OF_THE_PERCEIVER and saved.get("model") != self._model_id:
                strange.append(name)
            elif read[1] != self.configured[name]:
                edited.append(name)
            else:
                self.set(name, read[0])
        told = (
            ("edited in the file, which wins", edited),
            ("of another model, as configured", strange),
            ("unreadable, as configured", corrupt),
        )
        return [f"{', '.join(names)}: {what}" for what, names in told if names]


def kept_settings(known: Mapping[str, float], saved: Any) -> dict[str, float]:
    """The values in force before the perceiver is loaded: `known` configured ones, and what `saved` made.

    Where the configured value is the perceiver's own, it is taken to be the one that was set over.
    """
    rows = saved.get("values") if isinstance(saved, Mapping) else None
    if not isinstance(rows, Mapping):
        return dict(known)
    listed = {parameter.name: parameter for parameter in build((), {}, {})}
    own = {name: _read(listed[name], rows.get(name)) for name in OF_THE_PERCEIVER}
    presumed = {name: row[1] for name, row in own.items() if row is not None}
    overrides = Overrides({**presumed, **known}, saved.get("model"))
    overrides.restore(saved)
    return {**known, **overrides.values}


def _read(parameter: Parameter | None, row: Any) -> tuple[float, float] | None:
    """Value and the configured one that it was set over; None for anything else."""
    try:
        value, over = (float(one) for one in row if not isinstance(one, (bool, str)))
    except (TypeError, ValueError, OverflowError):
        return None
    return (value, over) if parameter is not None and parameter.accepts(value) else None
