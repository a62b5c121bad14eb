"""What a human who takes over has accepted by that."""

from __future__ import annotations

from dataclasses import replace

from anytraverse.assessment import Reason
from companion.calls.acceptance import Acceptance, blocked_by_name, scene_of
from companion.calls.decisions import Call
from companion.calls.sight import Sight


def accept_taken_over(call: Call | None, sight: Sight, now: float, travelled: float | None) -> None:
    """Whoever drives on by hand has seen what is there, and where; a fault cannot be accepted."""
    newest = sight.newest
    asked = call.reasons if call is not None and not call.answered else set[Reason]()
    reasons = (sight.reasons(now) | asked) - {Reason.FAULT}
    if Reason.BLOCKED in reasons and newest is not None and blocked_by_name(newest):
        reasons |= {Reason.UNKNOWN_OBJECT}  # which it may be taken for in the next frame
    scope = call.scope if call is not None else None
    if scope is not None and scope.thing is None and Reason.UNKNOWN_OBJECT in reasons:
        scope = None
    if scope is not None and newest is not None:
        scope = replace(scope, scene=scene_of(newest))
        if Reason.BLOCKED in reasons:  # a thing of its own, which no call was for
            blocked = Acceptance.of(newest, frozenset({Reason.BLOCKED}), sight.numbers, now, travelled)
            scope = scope.joined(blocked)
    sight.accept(reasons, scope, now, travelled)
    sight.look_afresh(now)
