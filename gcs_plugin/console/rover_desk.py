"""What the console knows of one rover: live figures, words, calls, files, a timeline. No I/O, no clock."""

from __future__ import annotations

import io
from collections import deque
from pathlib import Path
from typing import Any

from companion.wire.delivery import STATUS_TEXTS
from companion.wire.documents import FROM_ABOVE
from companion.wire.ids import Policy, State
from companion.wire.packing import clean
from companion.wire.parameters import ROI, THR_ROI, THR_SCENE, THR_TILE, THR_TRAV
from gcs_plugin.client import events as ev
from gcs_plugin.client.client import OperatorClient
from gcs_plugin.client.rovers import TrackedRover
from gcs_plugin.console.calls import Stories
from gcs_plugin.console.fetched import CALLS_PATH, Fetched
from gcs_plugin.console.incidents import RoverIncidents
from gcs_plugin.console.rover_page import RoverPage
from gcs_plugin.console.track import Track
from gcs_plugin.terminal import wording
from gcs_plugin.terminal.output import ALARM, GOOD, TextOutput, plain

POINTS = 300
"""Summaries that are plotted: five minutes."""
ENTRIES = 300
_TONES = {ALARM: "bad", GOOD: "good"}
_PROMPTS_STATE = (ev.StateChanged, ev.PolicyStatusChanged, ev.Acknowledged, ev.CallEnded)


class RoverDesk:
    """Follows one rover. `take` its events, then `step`; `document` is what the page shows."""

    def __init__(
        self,
        client: OperatorClient,
        rover: TrackedRover,
        folder: Path | None = None,
        page: RoverPage | None = None,
    ) -> None:
        """folder, page: of `RoverIncidents`."""
        self.rover = rover
        self.system = system = rover.system
        self.stories = Stories(system)
        self.fetched = Fetched(client, system, self.stories)
        self.incidents = RoverIncidents(client, system, self.fetched.files, folder, page)
        self.points: deque[tuple[float, float | None, float | None, float | None, float | None]] = deque(
            maxlen=POINTS
        )
        self.timeline: deque[dict[str, Any]] = deque(maxlen=ENTRIES)
        self.entries = 0
        """How many entries the timeline ever had."""
        self.summaries = 0
        """How many points there ever were."""
        self.track = Track()
        self._output = TextOutput(io.StringIO(), colours=False)

    def take(self, event: ev.Event, now: float, wall: float) -> None:
        """Take in an event of this rover. wall: seconds since 1970."""
        if isinstance(event, ev.SummaryReceived):
            self._plot(now)
            return
        if isinstance(event, _PROMPTS_STATE) or (isinstance(event, ev.LinkChanged) and event.up):
            self.fetched.state_wanted = True
        if isinstance(event, ev.TextReceived):
            self.stories.hear(event.text, wall)
        if isinstance(event, ev.ParameterReceived):
            return
        self._note(event, now, wall)

    def step(self, now: float, wall: float) -> bool:
        """Follow the rover's calls and files. Returns whether something changed."""
        rover = self.rover
        if rover.alive(now):
            self.incidents.step(now)
        moved = rover.position is not None and self.track.follow(rover.position)
        return self.fetched.step(rover, self.stories.follow(rover, wall, now), now) or moved

    def calls(self, now: float, ids: tuple[int, int] | None) -> list[dict[str, Any]]:
        """Return all calls for the page."""
        state = self.fetched.state
        told_open = state.open_call if state is not None else None
        return self.stories.documents(self.rover, now, ids, self._thresholds().get("scene"), told_open)

    def document(self, now: float, ids: tuple[int, int] | None) -> dict[str, Any]:
        """Return all that the page shows, but for points and timeline. Times are those of `now`."""
        rover, fetched = self.rover, self.fetched
        state = fetched.state
        counters, summary, computer = rover.counters, rover.summary, rover.computer
        heard = counters.summaries + counters.summaries_lost
        calls = self.calls(now, ids)
        lost = fetched.earlier == "coming" and not fetched.files.waits(CALLS_PATH)
        return {
            "system": self.system,
            "up": rover.alive(now),
            "heard": None if not rover.known else round(now - rover.silence(now), 2),
            "state": "" if rover.state is None else plain(rover.state),
            "elsewhere": rover.state is State.HOLDING and not rover.current_id,
            "current": rover.current_id,
            "policy": "" if rover.policy is None else plain(rover.policy),
            "offers_guide": rover.policy is Policy.GUIDE or (state is not None and state.guide_refused == ""),
            "guiding": rover.guiding,
            "signs": rover.signs,
            "position": None if rover.position is None else plain(rover.position),
            "vehicle": None if rover.vehicle is None else plain(rover.vehicle),
            "link": {
                "bytes": counters.bytes,
                "summaries": counters.summaries,
                "lost": counters.summaries_lost / heard if heard else None,
                "dropped": 0 if summary is None else summary.dropped,
                "unreadable": counters.unreadable,
                "rate": fetched.files.rate and round(fetched.files.rate),
            },
            "ahead": summary and {
                "frame_age": summary.frame_age_ms,
                "latency": summary.latency_ms,
                "field_of_view": summary.field_of_view,
                "sectors": summary.sectors,
                "reasons": plain(summary.reasons),
            },
            "thresholds": self._thresholds(),
            "words": self._words(),
            "words_known": fetched.words_are_known(rover),
            "given": dict(state.given) if state is not None else None,
            "names": [[word, weight] for word, weight in reversed(fetched.named.items())],
            "known_place": self._known_place(),
            "ground": {
                "picture": f"/pictures/{self.system}/ground.png?{fetched.grounds}" if fetched.ground else "",
                "coming": fetched.files.waits(FROM_ABOVE),
                "problem": clean(fetched.files.problems.get(FROM_ABOVE, "")),
            },
            "hold_refused": clean(state.hold_refused) if state is not None else "",
            "held_by": clean(state.held_by) if state is not None else "",
            "model": clean(state.model) if state is not None else "",
            "version": clean(state.version) if state is not None else "",
            "computer": "" if computer is None else wording.computer(computer, now),
            "shadow": wording.shadow(rover) if rover.policy is Policy.SHADOW else "",
            "checks": [
                {"check": clean(one.name), "verdict": one.verdict, "text": clean(one.text)}
                for one in fetched.checks
                if one.verdict in ("fail", "warn")
            ],
            "checked": fetched.checked,
            "earlier": "unknown" if lost else fetched.earlier,
            "calls": [
                call
                | fetched.pictures_of(call["id"])
                | {"incident": self.incidents.document(call["id"])}
                for call in calls
            ],
            "last_minute": self.incidents.document(0),
            "texts": [
                {"severity": severity, "text": clean(text)}
                for _, severity, text in list(rover.texts)[-6:]
            ],
        }  # fmt: skip

    def _plot(self, now: float) -> None:
        summary = self.rover.summary
        if summary is not None:
            self.summaries += 1
            self.points.append((
                round(now, 2), summary.roi_traversability, summary.roi_uncertainty, summary.worst_tile,
                summary.similarity,
            ))  # fmt: skip

    def _note(self, event: ev.Event, now: float, wall: float) -> None:
        call = 0
        match event:
            case ev.CallAnnounced(call=data) | ev.CallChanged(call=data):
                call = data.id
                lines, tone = [wording.headline(data, data.age_s)], "call"
            case ev.Acknowledged(acknowledgement=ack) if self.incidents.asked(ack.transaction):
                lines, tone = [f"incident file: {clean(ack.text)}"], ""
            case ev.AnswerStatusChanged() if self.incidents.asked(event.transaction):
                lines, tone = [f"incident file: {STATUS_TEXTS[event.status]}"], ""
            case _:
                lines, colour = self._output.lines(event, now)
                tone = _TONES.get(colour, "")
                if isinstance(event, ev.CallEnded):
                    call = event.call.id
        if lines:
            self.entries += 1
            self.timeline.append(
                {"n": self.entries, "at": round(wall, 2), "tone": tone, "text": lines[0], "call": call}
            )

    def _thresholds(self) -> dict[str, Any]:
        state = self.fetched.state
        settings = {**(state.settings if state is not None else {}), **self.rover.parameters}
        named = {"trav": THR_TRAV, "unc": THR_ROI, "tile": THR_TILE, "scene": THR_SCENE}
        found: dict[str, Any] = {
            name: value
            for name, parameter in named.items()
            if (value := settings.get(parameter)) is not None and value >= -1
        }
        roi = [settings.get(parameter) for parameter in ROI.values()]
        return found | {"roi": roi if None not in roi else None}

    def _words(self) -> list[dict[str, Any]]:
        state, words = self.fetched.state, self.fetched.words
        vocabulary = state.vocabulary if state is not None else ()
        used = [{"word": word, "weight": words[word], "fixed": word in vocabulary} for word in words]
        unused = [word for word in vocabulary if word not in words]
        return used + [{"word": word, "weight": None, "fixed": True} for word in unused]

    def _known_place(self) -> dict[str, Any] | None:
        known = self.fetched.state.known_place if self.fetched.state is not None else None
        if known is None:
            return None
        return {
            "call": known.call_id,
            "similarity": known.similarity,
            "needed": known.needed,
            "changed": {word: list(pair) for word, pair in known.changed.items()},
            "picture": f"/pictures/{self.system}/{known.call_id or 0}/place.jpg"
            if self.fetched.place_picture
            else "",
        }
