"""Follows all rovers and carries out what the page posts. No I/O: time comes as an argument."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from anytraverse.operations import SetWord, Tap
from companion.pages.given import Answered
from companion.pages.requests import RequestError, check_answer
from companion.wire.answers import Answer
from companion.wire.ids import Motion
from companion.wire.packing import PayloadError
from companion.wire.typed_answers import CommandError
from gcs_plugin.client import events as ev
from gcs_plugin.client.client import OperatorClient
from gcs_plugin.console.export import ExportedCall, pack
from gcs_plugin.console.requests import (
    FileRequest,
    IncidentFileRequest,
    IncidentRequest,
    Request,
    SetPolicyRequest,
    UndoRequest,
)
from gcs_plugin.console.rover_desk import RoverDesk
from gcs_plugin.console.rover_page import RoverPage
from gcs_plugin.terminal import wording
from gcs_plugin.terminal.output import Output
from gcs_plugin.terminal.resolve import choose_rover, current_call


class Console:
    """The desks of all rovers. revision: rises whenever something that the page shows has changed."""

    def __init__(
        self,
        client: OperatorClient,
        log: Output | None = None,
        folder: Path | None = None,
        pages: Mapping[int, RoverPage] | None = None,
        alert: Callable[[str, str], None] | None = None,
    ) -> None:
        """log: is told all events. folder: where incident files are stored; None: none are fetched.

        pages: the rovers' own ones, by system id, from which these files are fetched. alert: is told of each
        call, with a title and what it is about.
        """
        self.client = client
        self._folder = folder
        self._pages = pages or {}
        self._log = log
        self._alert = alert
        self.desks: dict[int, RoverDesk] = {}
        self.revision = 0
        self._progress_at = 0.0

    def step(self, now: float, wall: float) -> None:
        """Take in what has happened. wall: seconds since 1970."""
        happened = self.client.events()
        rovers = self.client.rovers
        for system in self.desks.keys() - rovers.keys():
            del self.desks[system]
            self.revision += 1
        for system, rover in rovers.items():
            if system not in self.desks or self.desks[system].rover is not rover:
                self.desks[system] = RoverDesk(self.client, rover, self._folder, self._pages.get(system))
                self.revision += 1
        for event in happened:
            self._to_log(event, now)
            if self._alert is not None and isinstance(event, ev.CallAnnounced):
                self._alert(*wording.alert(event.system, event.call))
            if event.system in self.desks:
                self.desks[event.system].take(event, now, wall)
        changed = [desk.step(now, wall) for desk in self.desks.values()]
        busy = self.client.busy and now - self._progress_at >= 0.5
        if happened or any(changed) or busy:
            self._progress_at = now
            self.revision += 1

    def _to_log(self, event: ev.Event, now: float) -> None:
        if self._log is None:
            return
        try:
            self._log.event(event, now, several=len(self.desks) > 1)
        except OSError as error:
            self._log = None
            logging.getLogger(__name__).error("the log ends here, it cannot be written: %s", error)

    def documents(self, now: float) -> list[dict[str, Any]]:
        """Return what is known of each rover; one that calls comes first."""
        shown = [desk.document(now, self.client.ids) for desk in self.desks.values()]
        return sorted(shown, key=lambda one: (_urgency(one), one["system"]))

    def picture(self, system: int, call: int, size: str) -> bytes | None:
        """Return a picture of a call, JPEG, if it has come."""
        desk = self.desks.get(system)
        if size == "place":
            return desk.fetched.place_picture or None if desk is not None else None
        story = desk.stories.by_id.get(call) if desk is not None else None
        return None if story is None else story.pictures.get(size)

    def ground(self, system: int) -> bytes | None:
        """Return what was known of the ground round a rover, from above, as PNG, if it has come."""
        desk = self.desks.get(system)
        return desk.fetched.ground or None if desk is not None else None

    def incident(self, system: int, name: str) -> Path | None:
        """Return where an incident file of a rover is stored; None for one that was not fetched."""
        desk = self.desks.get(system)
        return None if desk is None else desk.incidents.stored.get(name)

    def export(self, system: int, numbers: Sequence[int], now: float, wall: float) -> bytes | None:
        """Pack these calls of a rover, all for none given; None if one of them is not known."""
        desk = self.desks.get(system)
        if desk is None:
            return None
        calls = {one["id"]: one for one in desk.calls(now, self.client.ids)}
        chosen = list(dict.fromkeys(numbers)) or list(calls)
        if not chosen or not set(chosen) <= set(calls):
            return None
        pictures = desk.stories.by_id
        return pack(system, [ExportedCall(calls[one], pictures[one].pictures) for one in chosen], wall)

    def carry_out(self, system: int, request: Request, now: float, wall: float) -> str:
        """Carry out a request of the page; returns what was done. Raises RequestError."""
        self.revision += 1
        try:
            choose_rover(self.client.rovers, system)
            desk = self.desks[system]
            match request:
                case Answer():
                    return self._answer(request, desk, now, wall)
                case SetPolicyRequest():
                    self.client.set_policy(system, request.policy, now)
                    return f"policy {request.policy.name.lower()} is asked for"
                case UndoRequest():
                    return self._undo(request, desk, now)
                case FileRequest():
                    problem = desk.fetched.fetch(request.what, request.call)
                    if problem:
                        raise RequestError(problem)
                    return "asked for"
                case IncidentRequest():
                    desk.incidents.ask(request.call, now)
                    return "asked for"
                case IncidentFileRequest(name, stop):
                    (desk.incidents.stop if stop else desk.incidents.fetch)(name)
                    return "stopped" if stop else "asked for"
        except (CommandError, PayloadError, KeyError) as error:
            raise RequestError(str(error)) from error

    def _answer(self, answer: Answer, desk: RoverDesk, now: float, wall: float) -> str:
        rover = desk.rover
        call = rover.calls.get(answer.target)
        told = call.data if call is not None else None
        check_answer(answer, told, current_call(rover))
        pending = self.client.answer(desk.system, answer, now)
        state = desk.fetched.state
        tapped = state.tapped if state is not None else ()
        desk.stories.answered(Answered(pending, wall, dict(desk.fetched.words), told, tapped))
        named = (one for one in answer.operations if isinstance(one, SetWord | Tap))
        desk.fetched.note_named({one.word: one.weight for one in named})
        return "sent" if rover.alive(now) else "the rover is not heard: it is sent as soon as it is"

    def _undo(self, request: UndoRequest, desk: RoverDesk, now: float) -> str:
        if desk.rover.current_id:
            raise RequestError("a call is open: answer it first, then undo")
        operations = desk.stories.undo(request.call)
        if not operations:
            raise RequestError(f"nothing that this console answered to call {request.call} is left to undo")
        story = desk.stories.by_id[request.call]
        story.own.undone = self.client.answer(desk.system, Answer(0, Motion.NONE, operations), now)
        return "asked for"


_ORDER = ("calling", "holding", "fault", "blocked", "off", "starting", "ok")


def _urgency(shown: dict[str, Any]) -> int:
    if any(call["open"] for call in shown["calls"]):
        return -1
    state = shown["state"]
    return _ORDER.index(state) if state in _ORDER and shown["up"] else len(_ORDER)
