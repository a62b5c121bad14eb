"""Keeps the parameters that the ground has set, and applies them to how frames are judged. Pure.

Maps configuration and journal to the numbers, parameters and policy with which the daemon starts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from anytraverse.errors import RegionError, SettingsError
from anytraverse.judging import Settings
from anytraverse.memory import Memory, resumed_memory
from anytraverse.preferences import Preferences
from anytraverse.regions import Box
from companion.calls.numbers import Numbers
from companion.calls.policy import OffSwitch, PolicyState, Side
from companion.config import Config
from companion.config.stopping import SMALLEST_ROI
from companion.wire import parameters
from companion.wire.ids import Policy
from companion.wire.parameters import (
    ANSWER,
    BUDGET,
    NOT_IN_USE,
    NUMBER_RATE,
    POLICY,
    ROI,
    SHADOW_HOLDS,
    SUMMARY_RATE,
    TAP_WORD,
    THR_ROI,
    THR_SCENE,
    THR_TILE,
    THR_TRAV,
    Parameter,
    ParameterError,
    build,
)

THRESHOLDS: Mapping[str, str] = MappingProxyType(
    {parameters.THR_ROI: "roi", parameters.THR_SCENE: "scene", THR_TILE: "tile", parameters.THR_TRAV: "trav"}
)
"""Parameter -> field of `Thresholds`."""
OF_THE_PERCEIVER = (parameters.THR_ROI, parameters.THR_SCENE, THR_TILE)
"""Thresholds that have a meaning only for the perceiver that they were set for."""
_STORED_ELSEWHERE = frozenset({POLICY, ANSWER, SHADOW_HOLDS, TAP_WORD})
"""Settings that may be set and are stored elsewhere, or not at all."""


def judging_values(judging: Settings) -> dict[str, float]:
    """Return the parameters of thresholds and region of interest, name -> value."""
    bounds = judging.region.bounds
    found = {name: getattr(judging.thresholds, field) for name, field in THRESHOLDS.items()}
    values = {name: NOT_IN_USE if value is None else float(value) for name, value in found.items()}
    return values | {name: getattr(bounds, side) for side, name in ROI.items()}


def tuned(judging: Settings, values: Mapping[str, float], *, misfit_allowed: bool = False) -> Settings:
    """Return `judging` with some parameters' values. Raises SettingsError, with what to do in a few words.

    A region that the vehicle does not fit in already may change, so that it can be mended in steps.
    """
    thresholds: dict[str, Any] = {
        field: None if name == THR_TILE and values[name] == NOT_IN_USE else values[name]
        for name, field in THRESHOLDS.items()
        if name in values
    }
    sides = {side: values[name] for side, name in ROI.items() if name in values}
    return replace(
        judging,
        thresholds=replace(judging.thresholds, **thresholds),
        region=_region(judging.region.bounds, sides) if sides else judging.region,
        misfit_allowed=misfit_allowed or bool(judging.misfit),
    )


def _region(bounds: Box, sides: Mapping[str, float]) -> Box:
    box = {side: getattr(bounds, side) for side in ROI} | dict(sides)
    for low, high in (("left", "right"), ("top", "bottom")):
        if box[low] >= box[high]:
            raise SettingsError(f"ROI {low} must be < {high}")
        if box[high] - box[low] < SMALLEST_ROI - 1e-6:
            raise SettingsError(f"ROI {low} to {high} under {SMALLEST_ROI:g}")
    try:
        return Box(**box)
    except RegionError as error:
        raise SettingsError(str(error)) from error


class RuntimeSettings:
    """The parameters whose value differs from the configured one, name -> value."""

    def __init__(self, configured: Mapping[str, float], model_id: str) -> None:
        """configured: the configured values of all stored parameters. model_id: the perceiver's model."""
        self.configured = {name: round(value, 6) for name, value in configured.items()}
        self._model_id = model_id
        self._set: dict[str, float] = {}

    @property
    def values(self) -> Mapping[str, float]:
        """The values that count instead of the configured ones."""
        return dict(self._set)

    def set(self, name: str, value: float) -> None:
        """Set a value. One that equals the configured value is not stored, so the file counts again."""
        if value == self.configured[name]:
            self._set.pop(name, None)
        else:
            self._set[name] = value

    def drop(self, *names: str) -> None:
        """Return these parameters to their configured values."""
        for name in names:
            self._set.pop(name, None)

    def tuned(self, judging: Settings) -> tuple[Settings, list[str]]:
        """Apply the values to `judging`. Values that do not fit are dropped; the notices say which.

        A region that the vehicle does not fit in stays: that is a fault, and not for us to correct.
        """
        try:
            return tuned(judging, self._set, misfit_allowed=True), []
        except SettingsError as error:
            gone = [name for name in self._set if name in judging_values(judging)]
            self.drop(*gone)
            return judging, [f"{', '.join(gone)} as configured: {error}"]

    def saved(self) -> dict[str, Any]:
        """Return the values, with the configured ones that they replace, as JSON values for the journal."""
        values = {name: [value, self.configured[name]] for name, value in self._set.items()}
        return {"model": self._model_id, "values": values}

    def figures(self) -> dict[str, Any]:
        """Return what differs from the configuration, for the status file."""
        return {
            name: {"set": value, "configured": self.configured[name]} for name, value in self._set.items()
        }

    def restore(self, saved: Any) -> list[str]:
        """Restore what `saved` returned. Returns notices about values that were left out.

        Left out are values of another model, values that were edited in the file since, and invalid ones.
        """
        if saved is None:
            return []
        if not isinstance(saved, Mapping) or not isinstance(saved.get("values"), Mapping):
            return ["settings of the ground could not be read: as configured"]
        allowed = {parameter.name: parameter for parameter in build((), {}, {})}
        edited, of_other_model, corrupt = [], [], []
        for name, row in saved["values"].items():
            read = _read(allowed.get(name), row) if name in self.configured else None
            if read is None:
                corrupt.append(str(name))
            elif name in OF_THE_PERCEIVER and saved.get("model") != self._model_id:
                of_other_model.append(name)
            elif read[1] != self.configured[name]:
                edited.append(name)
            else:
                self.set(name, read[0])
        notices = (
            ("edited in the file, which wins", edited),
            ("of another model, as configured", of_other_model),
            ("unreadable, as configured", corrupt),
        )
        return [f"{', '.join(names)}: {what}" for what, names in notices if names]


def saved_settings(known: Mapping[str, float], saved: Any) -> dict[str, float]:
    """Return the values in force before the perceiver is loaded.

    known: the configured values that are known already. saved: as `RuntimeSettings.saved` returned it. A
    default of the perceiver is not known yet: it is assumed to be the one that the saved value replaced.
    """
    rows = saved.get("values") if isinstance(saved, Mapping) else None
    if not isinstance(rows, Mapping):
        return dict(known)
    listed = {parameter.name: parameter for parameter in build((), {}, {})}
    own = {name: _read(listed[name], rows.get(name)) for name in OF_THE_PERCEIVER}
    presumed = {name: row[1] for name, row in own.items() if row is not None}
    overrides = RuntimeSettings({**presumed, **known}, saved.get("model"))
    overrides.restore(saved)
    return {**known, **overrides.values}


def _read(parameter: Parameter | None, row: Any) -> tuple[float, float] | None:
    """Return a saved value and the configured value that it replaced, None for anything else."""
    try:
        value, over = (float(one) for one in row if not isinstance(one, (bool, str)))
    except (TypeError, ValueError, OverflowError):
        return None
    return (value, over) if parameter is not None and parameter.accepts(value) else None


def call_numbers(config: Config, judging: Settings) -> Numbers:
    """Make the state machine's numbers from the configuration. judging: the thresholds and ROI in force."""
    call = config.call
    return Numbers(
        judging=judging,
        votes=call.votes,
        window=call.window,
        ok_frames=call.ok_frames,
        passed_after=call.passed_after,
        accepted_for=call.accepted_for,
        accepted_distance=call.accepted_distance,
        accepted_rise=call.accepted_rise,
        go_lasts=call.go_lasts,
        fault_ends_hold=call.fault_ends_hold,
        px4_hold=call.px4_hold,
    )


def first_values(config: Config, saved: Any = None) -> dict[str, float]:
    """Return the parameters' values before the perceiver is loaded.

    saved: the settings in the journal, which the ground had set.
    """
    roi_sides = {name: getattr(config.roi, side) for side, name in ROI.items()}
    limits = config.thresholds
    tile = NOT_IN_USE if limits.tile == "off" else limits.tile
    thresholds = {THR_ROI: limits.roi, THR_SCENE: limits.scene, THR_TILE: tile, THR_TRAV: limits.trav}
    configured = {name: float(value) for name, value in thresholds.items() if value is not None}
    return saved_settings({**configured, **roi_sides, **_rates(), BUDGET: config.link.budget}, saved)


def first_words(config: Config, saved: Memory | None) -> Preferences:
    """Return the words in force before the perceiver is loaded. saved: the memory in the journal."""
    if saved is None:
        return config.preferences
    return resumed_memory(saved, saved.model_id, config.preferences, lambda word: word)[0].preferences


def storable_defaults(config: Config, judging: Settings) -> dict[str, float]:
    """Return the configured values of the parameters that are stored when the ground sets them.

    Raises ParameterError where a parameter may be set, but has no configured value to be stored against.
    """
    values = {**judging_values(judging), **_rates(), BUDGET: config.link.budget}
    settable = {parameter.name for parameter in build((), {}, {}) if not parameter.read_only}
    if missing := settable - _STORED_ELSEWHERE - values.keys():
        raise ParameterError(f"{', '.join(sorted(missing))} cannot be stored: add to storable_defaults")
    return values


def _rates() -> dict[str, float]:
    defaults = {parameter.name: parameter.value for parameter in build((), {}, {})}
    return {name: defaults[name] for name in (SUMMARY_RATE, NUMBER_RATE)}


def restored_policy(config: Config, saved: Any, now: float) -> PolicyState:
    """Make the configured policy with its off switch. saved: as `PolicyState.saved` returned it.

    Off stays off over a restart. Whether hold can be given is not checked here. now: monotonic seconds.
    """
    call = config.call
    switch = OffSwitch(call.off_channel, Side(call.off_side), now) if call.off_channel else None
    policy_state = PolicyState(Policy[call.policy.upper()], switch)
    policy_state.restore(saved)
    return policy_state
