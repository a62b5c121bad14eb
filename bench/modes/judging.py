"""Judges by the autopilot's mode log whether a human was overridden, and for how long our mode then stood."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

HAND, STATION = "hand", "gcs"
PRESSED = ("HOLD", "GUIDED")
"""Modes that are pressed at a ground station: inside our own they have no entry in the mode log."""
DRIVING = ("AUTO", "GUIDED")
SLACK = 0.5
"""s beside the round trip within which a human's mode that a resume replaced must be held again."""


@dataclass(frozen=True)
class ModeSetting:
    """How a trial was set up. script: on the autopilot. delay: s, each way. busy: beside two busy loops.

    brakes: the script brakes before it sets HOLD, and only holds are tried.
    """

    script: bool
    delay: float
    busy: bool
    brakes: bool = False


@dataclass(frozen=True)
class ModeTrial:
    """A human's mode round one command of the companion.

    command: hold or resume. mode: the human's; HOLD is pressed inside our HOLD, GUIDED round the brake, both
    at a ground station. offset: s by which the human's mode comes after the command, at `moment` (leaves: it
    leaves the companion; arrives: it reaches the autopilot). kept: s for which the wire keeps the command, so
    that the human is first.
    """

    command: str
    mode: str
    moment: str
    offset: float
    kept: float = 0.0


@dataclass(frozen=True)
class ModeOutcome:
    """What came out. measured: s from the command's leaving to the human's mode; None: no command left.

    changes: modes that the autopilot entered after the human's and by no hand. overridden: there was one.
    drove: longest s for which a driving mode stood then; None: none did. ended: no such mode stands now.
    inside: our mode in which the human's came, where the script brakes. again: the companion took the human's
    GUIDED for what it is, and has begun another hold for the fault that stands.
    """

    setting: ModeSetting
    trial: ModeTrial
    measured: float | None
    changes: tuple[str, ...]
    drove: float | None
    ended: bool
    inside: str = ""
    again: bool = False

    @property
    def overridden(self) -> bool:
        return bool(self.changes) and not self.again

    @property
    def over_round_trip(self) -> float | None:
        """By how many s our driving mode stood longer than the command's round trip; None: it never did."""
        return None if self.drove is None else self.drove - 2 * self.setting.delay - self.trial.kept

    @property
    def good(self) -> bool:
        """Whether it is as promised: with the script nobody is overridden, without it nobody for long."""
        if self.setting.script:
            return not self.overridden
        return self.over_round_trip is None or (self.ended and self.over_round_trip <= SLACK)


def since_human(log: Sequence[Mapping[str, Any]], mode: str, since: float) -> list[Mapping[str, Any]] | None:
    """Returns the entries after the human's last one of this mode since then; None where there is none.

    since: rover time in s, of the entries as well. HOLD pressed inside our HOLD changes nothing and has no
    entry, so that all after our HOLD came after the press.
    """
    recent = [row for row in log if row["t"] >= since]
    by = STATION if mode in PRESSED else HAND
    at = [n for n, row in enumerate(recent) if row["by"] == by and row["mode"] == mode]
    if not at and mode in PRESSED:
        at = [n for n, row in enumerate(recent) if row["mode"] == mode][:1]
    return recent[at[-1] + 1 :] if at else None


def drove(after: Sequence[Mapping[str, Any]], until: float) -> tuple[float | None, bool]:
    """Returns the longest s for which a driving mode stood that no hand set, and whether all of them ended.

    None: there was none. until: rover time in s at which the watching ended.
    """
    ends = [*(row["t"] for row in after), until][1:]
    stood = [
        end - row["t"]
        for row, end in zip(after, ends, strict=True)
        if row["mode"] in DRIVING and row["by"] != HAND
    ]
    return max(stood, default=None), not after or after[-1]["mode"] not in DRIVING


def figures(outcomes: Sequence[ModeOutcome], disturbed: int = 0) -> dict[str, Any]:
    """Sums up. longest_override_s: of a driving mode; an override by HOLD leaves the rover standing."""
    driven = [one for one in outcomes if one.drove is not None]
    found = {
        "trials": len(outcomes),
        "overridden_with_script": sum(one.overridden for one in outcomes if one.setting.script),
        "overridden_without": sum(one.overridden for one in outcomes if not one.setting.script),
        "longest_override_s": round(max((one.drove or 0.0 for one in driven), default=0.0), 3),
        "worst_over_round_trip_s": _worst(driven),
    }
    return {
        **found,
        "held_again": sum(one.again for one in outcomes),
        "inside": dict(Counter(one.inside for one in outcomes if one.inside)),
        "driven_over_without": sum(one.drove is not None for one in outcomes if not one.setting.script),
        "no_command_left": sum(one.measured is None for one in outcomes),
        "wrong": sum(not one.good for one in outcomes),
        "disturbed": disturbed,
        "settings": [_of(setting, outcomes) for setting in dict.fromkeys(one.setting for one in outcomes)],
    }


def _of(setting: ModeSetting, outcomes: Sequence[ModeOutcome]) -> dict[str, Any]:
    own = [one for one in outcomes if one.setting == setting]
    driven = [one for one in own if one.drove is not None]
    return {
        "script": setting.script,
        "delay_ms": round(1000 * setting.delay),
        "busy": setting.busy,
        "brakes": setting.brakes,
        "trials": len(own),
        "overridden": sum(one.overridden for one in own),
        "driven_over": len(driven),
        "longest_override_s": round(max((one.drove or 0.0 for one in driven), default=0.0), 3),
    }


def _worst(driven: Sequence[ModeOutcome]) -> float | None:
    return max((round(one.over_round_trip or 0.0, 3) for one in driven), default=None)


def line(outcome: ModeOutcome) -> str:
    """Formats a trial as a line for a reader."""
    setting, trial = outcome.setting, outcome.trial
    measured = "no command" if outcome.measured is None else f"{1000 * outcome.measured:+.0f} ms"
    told = (
        f"{'script' if setting.script else 'none':6} {1000 * setting.delay:3.0f} ms "
        f"{'busy' if setting.busy else 'idle'}  {trial.command:6} {trial.mode:8} "
        f"{trial.moment} {1000 * trial.offset:+4.0f} ms (from leaving: {measured})"
    )
    told += f"  then {', '.join(outcome.changes)}" if outcome.changes else ""
    told += f"  inside {outcome.inside}" if outcome.inside else ""
    told += "  held again" if outcome.again else ""
    told += f"  drove {outcome.drove:.2f} s" if outcome.drove is not None else ""
    return told + ("" if outcome.good else "  WRONG")
