"""Tells by what a detection zone is judged, and what has changed since one was measured."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict
from typing import Any

from anytraverse.errors import AnyTraverseError
from anytraverse.judging import Settings
from anytraverse.memory import Memory
from anytraverse.preferences import Preferences
from companion.config import Config
from companion.desk.check.rover import CheckedRover
from companion.desk.check.zone_file import Zone
from companion.storage.database import JournalError
from companion.storage.journal_copy import read_stored_memory

_LIMITS = ("roi", "scene", "tile", "trav", "margin")


def judged_by(config: Config, settings: Settings | None) -> dict[str, Any]:
    """Return thresholds, region and mount as a `Zone` has them.

    settings: those in force; None: the mount alone.
    """
    found: dict[str, Any] = {"mount": asdict(config.mount) | {"view": config.camera.view}}
    if settings is None:
        return found
    limits, ground = settings.thresholds, settings.metres
    votes = {"votes": float(config.call.votes), "window": float(config.call.window)}
    metres = {name: getattr(ground, name, None) for name in ("near", "far", "width", "tile")}
    return found | {
        "thresholds": {name: getattr(limits, name) for name in _LIMITS} | votes,
        "region": asdict(settings.region.bounds) | metres,
    }


def changed_since(zone: Zone, rover: CheckedRover) -> list[str]:
    """Return what a zone was measured with and is another one now. What is not known now is left out."""
    return [name for name, now in _now(zone, rover) if getattr(zone, name) != now]


def _now(zone: Zone, rover: CheckedRover) -> Iterator[tuple[str, Any]]:
    settings, model, words = None, "", None
    if rover.running is None:
        settings, model = rover.perceives.judging, rover.perceives.model
        with suppress(JournalError):
            words = _words(rover.config.preferences, read_stored_memory(rover.folder))
    else:
        model = str(rover.told("perceiver").get("model") or "")
        with suppress(AnyTraverseError):
            words = dict(Preferences.parse(str(rover.running.get("words") or "")))
    if model:
        same = f"{model},".startswith(f"{zone.model},")  # behind it may stand its precision
        yield "model", zone.model if same else model
    if words:
        yield "words", words
    yield from judged_by(rover.config, settings).items()


def _words(configured: Preferences, memory: Memory | None) -> dict[str, float]:
    """Return the words with which a companion would start. memory: the journal's."""
    if memory is None:
        return dict(configured)
    removed = (word for word in memory.configured if word not in configured)
    edited = {word: one for word, one in configured.items() if memory.configured.get(word) != one}
    return {**memory.preferences.without(*removed), **edited}
