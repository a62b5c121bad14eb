"""Decides when the scene is looked at anew, and when its last embedding may stand for it."""

from __future__ import annotations

from typing import NamedTuple

from anytraverse.assessment import Assessment, Reason
from anytraverse.findings import find_scene
from anytraverse.history import Embedding, cosine
from anytraverse.judging import Settings


class _Scene(NamedTuple):
    """An embedding, and when the frame was taken that it was made from: the caller's monotonic seconds."""

    embedding: Embedding
    at: float


class SceneWatch:
    """Keeps the newest embedding of a stream of frames, which may be used for later frames, too.

    A new one is calculated on every N-th frame (`Settings.scene_every`), when the last is older than
    `Settings.freshness`, and after a fault. While the scene is in doubt, each frame gets its own: until the
    last `window` embeddings in a row were clear of the scene's threshold, and the newest is clear of the
    present one.

    So an embedding that makes a scene unknown, matches a remembered scene or ends a doubt is always the
    frame's own. Each embedding is one vote, as the rule "n of m frames" expects. A new place is noticed at
    most N frames late, and within the freshness limit.
    """

    def __init__(self) -> None:
        self._newest: _Scene | None = None
        self._frames = 0
        """For how many frames the newest embedding was used, its own frame included."""
        self._clear = 0
        """How many embeddings in a row were clear."""

    def take(self, settings: Settings, reference: Embedding | None, now: float) -> _Scene | None:
        """Return the embedding to use for a new frame, None where it needs its own. `judged` puts it back."""
        scene, self._newest = self._newest, None
        if scene is None or reference is None or self._clear < settings.window:
            return None
        if self._frames >= settings.scene_every or not 0.0 <= now - scene.at <= settings.freshness:
            return None
        found = find_scene(cosine(reference, scene.embedding), settings)
        return scene if all(finding.clear for finding in found) else None

    def judged(self, seen: Assessment) -> None:
        """Note that a new frame was judged, with an embedding of its own or with the one that was taken."""
        observation = seen.observation
        if observation is None or Reason.FAULT in seen.reasons:
            self._newest, self._clear = None, 0
            return
        if observation.scene_at is None:
            self._frames = 0
            self._clear = self._clear + 1 if seen.is_clear(Reason.UNKNOWN_SCENE) else 0
        self._frames += 1
        at = observation.frame.captured_at - observation.scene_age
        self._newest = _Scene(observation.embedding, at)
