"""Maps configuration and journal to the numbers, parameters and policy with which the daemon starts."""

from __future__ import annotations

from typing import Any

from anytraverse.judging import Settings
from anytraverse.memory import Memory, resumed_memory
from anytraverse.preferences import Preferences
from companion.calls.numbers import Numbers
from companion.calls.policy import OffSwitch, PolicyState, Side
from companion.config import Config
from companion.daemon.settings.runtime import judging_values, saved_settings
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
    ParameterError,
    build,
)

_STORED_ELSEWHERE = frozenset({POLICY, ANSWER, SHADOW_HOLDS, TAP_WORD})
"""Settings that may be set and are stored elsewhere, or not at all."""


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
