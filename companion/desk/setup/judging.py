"""Judges the newest picture by the words of the draft, at once when a weight changes."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np

from anytraverse.assessment import Observation
from anytraverse.drawing import fitted
from anytraverse.engine import AnyTraverse
from anytraverse.errors import AnyTraverseError
from anytraverse.frame import Frame, Image
from anytraverse.judged_picture import draw_judgement, figures
from anytraverse.memory import first_memory
from anytraverse.perception import Perceiver, make_perceiver
from anytraverse.preferences import Preferences
from companion.config import Config
from companion.desk.setup.preview import PreviewPicture
from companion.pages.requests import RequestError
from companion.vision.messages import Model
from companion.vision.warm_up import judging_settings

_QUALITY = 88
_NARROWEST = 640
"""Pixels: outlines of the judgement would be broad in a narrower picture."""
_SHARE = 0.5
"""Attention from which on a pixel counts as explained by a word."""


class LiveMap:
    """Holds the perceiver, and the newest picture as it sees it. One caller at a time; the others wait."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._loaded: tuple[object, Perceiver] | None = None
        self._seen: tuple[int, Observation] | None = None
        self.jpeg = b""
        """The picture that was judged last, as JPEG."""

    def judge(self, config: Config, live: PreviewPicture, words: Mapping[str, float]) -> dict[str, Any]:
        """Judge a picture by these words. Takes seconds the first time.

        Returns figures as JSON values; the picture is in `jpeg`. Raises RequestError.
        """
        if not live.jpeg:
            raise RequestError("no picture has come: see page 1, camera")
        with self._lock:
            began = time.monotonic()
            try:
                return self._judge(config, live, words) | {"seconds": round(time.monotonic() - began, 3)}
            except AnyTraverseError as error:
                raise RequestError(str(error)) from error

    def _judge(self, config: Config, live: PreviewPicture, words: Mapping[str, float]) -> dict[str, Any]:
        perceiver = self._perceiver(config)
        preferences = Preferences.of(dict(words))
        settings = judging_settings(config, perceiver, misfit_allowed=True)
        engine = AnyTraverse(perceiver, settings, first_memory(perceiver.model_id, preferences, 1))
        if self._seen is None or self._seen[0] != live.number:
            self._seen = live.number, engine.observe(Frame(live.number, 0.0, _decoded(live.jpeg)))
        seen = engine.judge(self._seen[1], 0.0)
        region = settings.at(None).region
        image = self._seen[1].frame.image
        picture = fitted(image, max(_NARROWEST, image.shape[1]))
        draw_judgement(picture, seen, region)
        turned = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
        self.jpeg = cv2.imencode(".jpg", turned, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes()
        shares: dict[str, float] = {}
        if seen.maps is not None:
            drivable, unknown = seen.maps.signed > _SHARE, seen.maps.uncertainty > _SHARE
            shares = {
                "drivable": round(float(drivable.mean()), 3),
                "not drivable": round(float((seen.maps.signed < -_SHARE).mean()), 3),
                "unknown": round(float(unknown.mean()), 3),
            }
        return {
            "number": live.number,
            "model": str(Model.of(perceiver)),
            "ok": seen.ok,
            "reasons": sorted(reason.value for reason in seen.reasons),
            "figures": figures(seen),
            "shares": shares,
            "misfit": settings.misfit,
        }

    def _perceiver(self, config: Config) -> Perceiver:
        name, runtime = config.perceiver.name, config.perceiver.runtime
        if self._loaded is None or self._loaded[0] != (name, runtime):
            self._seen = None
            self._loaded = (name, runtime), make_perceiver(name, runtime)
        return self._loaded[1]


def _decoded(jpeg: bytes) -> Image:
    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise RequestError("the camera's process sent no picture")
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))
