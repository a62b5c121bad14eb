"""Has an incident packed, or no more, when an answer asks for that."""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import Protocol

from companion.link.link import Link
from companion.vision.client import VisionClient
from companion.wire.answers import Acknowledgement, Answer, CancelIncident, IncidentRequest, PackIncident
from companion.wire.ids import Motion, Result, words_hash

log = logging.getLogger(__name__)


class Packer(Protocol):
    """Packs incidents, see `IncidentPacker`."""

    def ask(self, call: int, now: float) -> tuple[Result, str]:
        """Have one packed. Returns what the requester is told."""

    def cancel(self, call: int, now: float) -> tuple[Result, str]:
        """Have it packed no more. Returns what the requester is told."""


class IncidentRequests:
    """Answers such requests, which answer no call, and teach nothing. packer: None: nothing is packed."""

    def __init__(self, link: Link, vision: VisionClient) -> None:
        self._link = link
        self._vision = vision
        self.packer: Packer | None = None

    def receive(self, answer: Answer, now: float) -> bool:
        """Take an answer, if it is such a request. Whether it was."""
        if not any(isinstance(one, IncidentRequest) for one in answer.operations):
            return False
        result, text = self._result(answer, now)
        ack = Acknowledgement.without_figures(answer.transaction, 0, result, text)
        self._link.answers.acknowledge(answer, replace(ack, words=words_hash(self._vision.words)), now)
        log.info("incident file: %s %s", ack.result.name, ack.text)
        return True

    def _result(self, answer: Answer, now: float) -> tuple[Result, str]:
        match answer.operations:
            case (PackIncident() | CancelIncident(),) if answer.motion is Motion.NONE and self.packer is None:
                return Result.REFUSED, "nothing is packed here"
            case (PackIncident(call_id),) if answer.motion is Motion.NONE and self.packer is not None:
                return self.packer.ask(call_id, now)
            case (CancelIncident(call_id),) if answer.motion is Motion.NONE and self.packer is not None:
                return self.packer.cancel(call_id, now)
        return Result.REFUSED, "an incident file is asked for alone, without motion or words"
