"""Lists what is recorded: one row a topic of the MCAP files."""

from __future__ import annotations

import json
from collections.abc import Mapping
from enum import IntEnum
from types import MappingProxyType
from typing import Any, NamedTuple

from companion.observers.recording.foxglove import descriptors

FOXGLOVE = "foxglove."
"""Schemas whose name begins so are Foxglove's own, encoded as protobuf; all others are JSON."""


class Topic(IntEnum):
    """Numbers the topics for the wire between supervisor and recording process."""

    CAMERA = 0
    ANNOTATIONS = 1
    TRAVERSABILITY = 2
    UNCERTAINTY = 3
    ASSESSMENT = 4
    WORDS = 5
    SETTINGS = 6
    SETUP = 7
    STATE = 8
    DECISIONS = 9
    REQUESTS = 10
    ACKNOWLEDGEMENTS = 11
    VEHICLE = 12
    LOCATION = 13
    STATUS = 14
    LOG = 15
    GROUND = 16
    PLAN = 17


class _Row(NamedTuple):
    """One row of the table.

    fields: the properties of its JSON schema, name -> JSON type; empty for Foxglove's own. standing: it holds
    until the next message of its kind, so that each file begins with the newest one.
    """

    name: str
    schema: str
    does: str
    fields: Mapping[str, str] = MappingProxyType({})
    standing: bool = False

    @property
    def encoding(self) -> str:
        """How messages are encoded, in MCAP's names."""
        return "protobuf" if self.schema.startswith(FOXGLOVE) else "json"

    @property
    def schema_encoding(self) -> str:
        """How the schema is, in MCAP's names."""
        return "protobuf" if self.schema.startswith(FOXGLOVE) else "jsonschema"

    @property
    def schema_data(self) -> bytes:
        """The schema itself."""
        if self.schema.startswith(FOXGLOVE):
            return descriptors(self.schema)
        # A field may be null where nothing is known; viewers want one type of it all the same.
        properties: dict[str, Any] = {name: {"type": kind} for name, kind in self.fields.items()}
        described = {"title": self.schema, "description": self.does, "type": "object"}
        return json.dumps({**described, "properties": properties}).encode()


_FRAME = {"frame": "integer", "captured_at": "number"}
_JUDGED = {
    **_FRAME,
    **dict.fromkeys(("judged_at", "duration", "age", "similarity", "scene_age", "reach"), "number"),
    **dict.fromkeys(("traversability", "uncertainty", "strangeness", "drivable_share"), "number"),
    **dict.fromkeys(("ok", "undecided"), "boolean"),
    **dict.fromkeys(("reasons", "findings", "sectors", "dropped", "lean", "pose"), "array"),
    **dict.fromkeys(("roi", "match", "adopted"), "object"),
}
_STATE = {
    **dict.fromkeys(("state", "policy", "kind", "stage", "held_by", "vision", "link"), "string"),
    "open": "integer",
    "holding": "boolean",
    "reasons": "array",
}
_VEHICLE = {
    **dict.fromkeys(("custom_mode", "autopilot", "type", "system_id", "reboots"), "integer"),
    "armed": "boolean",
    **dict.fromkeys(("speed", "heard_at", "position_at", "clock"), "number"),
    **dict.fromkeys(("position", "attitude"), "array"),
}
TOPICS: Mapping[Topic, _Row] = MappingProxyType(
    {
        Topic.CAMERA: _Row("/camera", "foxglove.CompressedImage", "a judged frame, JPEG as captured"),
        Topic.ANNOTATIONS: _Row(
            "/camera/annotations", "foxglove.ImageAnnotations", "region of interest, place meant, state"
        ),
        Topic.TRAVERSABILITY: _Row(
            "/maps/traversability", "foxglove.CompressedImage", "the signed map, grey PNG: 0 is -1, 255 is 1"
        ),
        Topic.UNCERTAINTY: _Row(
            "/maps/uncertainty", "foxglove.CompressedImage", "grey PNG: 0 is 0, 255 is 1"
        ),
        Topic.ASSESSMENT: _Row(
            "/assessment", "anytraverse.Assessment", "what each frame was judged as", _JUDGED
        ),
        Topic.WORDS: _Row(
            "/words",
            "anytraverse.Words",
            "words in use, and how many taps each has",
            {"words": "object", "taps": "object"},
            standing=True,
        ),
        Topic.SETTINGS: _Row(
            "/settings",
            "anytraverse.Settings",
            "parameters in force, and by what frames are judged",
            {"parameters": "object", "judging": "object"},
            standing=True,
        ),
        Topic.SETUP: _Row(
            "/setup",
            "anytraverse.Setup",
            "versions, model and configuration, without secrets",
            dict.fromkeys(("version", "python", "computer", "model", "config"), "string"),
            standing=True,
        ),
        Topic.STATE: _Row(
            "/state", "anytraverse.State", "the companion's state, when it changes", _STATE, standing=True
        ),
        Topic.DECISIONS: _Row(
            "/decisions",
            "anytraverse.Decision",
            "calls and holds: opened, closed, started, ended",
            {"decision": "string", "id": "integer", "reasons": "array"},
        ),
        Topic.REQUESTS: _Row(
            "/requests",
            "anytraverse.Request",
            "answers, parameters and policies, as received",
            {"request": "string"},
        ),
        Topic.ACKNOWLEDGEMENTS: _Row(
            "/acknowledgements",
            "anytraverse.Acknowledgement",
            "what answers led to, when it is acknowledged",
            {"target": "integer", "result": "string", "text": "string"},
        ),
        Topic.VEHICLE: _Row(
            "/vehicle", "anytraverse.Vehicle", "what the autopilot reports, 5 a second at most", _VEHICLE
        ),
        Topic.LOCATION: _Row("/location", "foxglove.LocationFix", "where the vehicle is"),
        Topic.STATUS: _Row(
            "/status", "anytraverse.Status", "status.json, once a second", {"state": "string"}
        ),
        Topic.LOG: _Row("/log", "foxglove.Log", "the lines of the log"),
        Topic.GROUND: _Row(
            "/ground",
            "foxglove.Grid",
            "what is known of the ground, by odometry, 1 a second; 0 to 254 for 0 to 1, 255 is not known",
        ),
        Topic.PLAN: _Row(
            "/plan",
            "anytraverse.Plan",
            "the way that policy guide planned after a frame: pose by odometry, curvature and length of arcs",
            {
                **dict.fromkeys(("at", "route_clear", "clear", "gap"), "number"),
                **dict.fromkeys(("pose", "arcs"), "array"),
                "route_blocked": "boolean",
            },
        ),
    }
)
