"""Finds the answered scene most like a call's, so that its answer can be given again at the desk."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from anytraverse.engine import AnyTraverse
from companion.desk.drives.rehearsal import AskedCall
from companion.pages import wording
from companion.pages.calls import named_thing, nearest
from companion.pages.given import OwnAnswers
from companion.wire.call_report import NearestScene


def nearest_to(call: AskedCall, calls: Sequence[AskedCall], engine: AnyTraverse) -> dict[str, Any] | None:
    """Return what the card of a call shows of that scene, None without one. calls: of the drive."""
    memory, known = engine.memory, {one.id: one for one in calls}
    unanswered = {number for number, one in known.items() if not one.by_person}
    match = memory.nearest_answered(call.embedding, unanswered)
    if match is None:
        return None
    scene = NearestScene(match.entry.call_id or None, match.similarity, memory.taught(match.entry), "")
    alike = engine.settings.thresholds.scene
    there = known.get(match.entry.call_id)
    if there is None:  # of the memory that the drive began with
        return nearest(scene, "the answer was", "", alike, "", None)
    record = there.record
    motion = wording.newest_motion([one.motion for one in record.answers])
    named = named_thing(OwnAnswers(), record)
    return nearest(scene, "you said", motion, alike, f"/calls/{there.id}-raw.jpg", named)
