"""When the scene is looked at anew, when its last embedding may stand for it, and where a place ends."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

from anytraverse.assessment import Assessment, Reason
from anytraverse.findings import find_scene
from anytraverse.history import Embedding, Place, cosine
from anytraverse.judging import Settings


class Scene(NamedTuple):
    """An embedding, and when the frame was taken that it was made from: the caller's monotonic seconds."""

    embedding: Embedding
    at: float


BELOW = 0.05
"""By how much less than the threshold asks a frame may resemble an answered place that is carried along."""
ABOVE = 0.03
"""By how much more than the threshold asks a frame must resemble the answered place to become the one that
later frames are compared with. Frames of less lead into the next place, step by step."""
CARRIED_FOR = 60.0
CARRIED_METRES = 50.0


@dataclass(frozen=True, eq=False)
class CarriedPlace:
    """A new place that was answered, on the way on from it, for at most a minute and, where known, 50 m.

    A frame that resembles `embedding` as the threshold asks, and the answered one nearly so, shows the same
    place. `embedding` is the newest frame's that resembled the answered one by more than the threshold asks.
    reference: the answered one, or that of a thing which was named here since.
    since: the caller's monotonic seconds.
    """

    answered: Embedding
    embedding: Embedding
    reference: Embedding
    since: float
    place: Place

    def similarity(self, embedding: Embedding) -> float:
        """To be judged as one to the reference is; NaN where nothing can be compared."""
        return min(cosine(self.embedding, embedding), cosine(self.answered, embedding) + BELOW)

    def moved(self, embedding: Embedding, threshold: float) -> CarriedPlace:
        """On to a new frame, if that shows the answered place plainly."""
        plain = cosine(self.answered, embedding) >= threshold + ABOVE
        return replace(self, embedding=embedding) if plain else self

    def holds(self, reference: Embedding | None, now: float, place: Place) -> bool:
        """Whether it is the reference's place still, within its limits."""
        metres = self.place.metres_to(place)
        far = metres is not None and metres > CARRIED_METRES
        return reference is self.reference and not far and 0.0 <= now - self.since <= CARRIED_FOR


class SceneWatch:
    """The newest embedding of a stream of frames, which may stand for frames after its own.

    It is made anew on every N-th frame (`Settings.scene_every`), when it is older than `Settings.freshness`,
    and after a fault. And while there is any doubt it is made on every frame: until the last `window`
    embeddings in a row were clear of the scene's threshold, and the newest is clear of today's.

    So an embedding that says "unknown scene", fits a remembered scene or ends a doubt is always the frame's
    own. One embedding is one vote, and n of m frames need no other rule. A new place is noticed at most N
    frames late, and within the freshness limit.
    """

    def __init__(self) -> None:
        self._newest: Scene | None = None
        self._frames = 0
        """Frames that the newest was used for, its own among them."""
        self._clear = 0
        """Embeddings in a row that were clear."""

    def take(self, settings: Settings, reference: Embedding | None, now: float) -> Scene | None:
        """The scene that may stand for a new frame, or None: make one. `judged` gives it back."""
        scene, self._newest = self._newest, None
        if scene is None or reference is None or self._clear < settings.window:
            return None
        if self._frames >= settings.scene_every or not 0.0 <= now - scene.at <= settings.freshness:
            return None
        found = find_scene(cosine(reference, scene.embedding), settings)
        return scene if all(finding.clear for finding in found) else None

    def judged(self, seen: Assessment) -> None:
        """A new frame was judged, by a scene of its own or by the one that was taken."""
        observation = seen.observation
        if observation is None or Reason.FAULT in seen.reasons:
            self._newest, self._clear = None, 0
            return
        if observation.scene_at is None:
            self._frames = 0
            self._clear = self._clear + 1 if seen.is_clear(Reason.UNKNOWN_SCENE) else 0
        self._frames += 1
        at = observation.frame.captured_at - observation.scene_age
        self._newest = Scene(observation.embedding, at)
