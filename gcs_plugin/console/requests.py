"""Reads what the console's page posts. Each value is checked; a RequestError says what is wrong. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from companion.pages.requests import (
    RequestError,
    read_answer,
    read_incident,
    read_object,
    whole,
)
from companion.wire.answers import Answer
from companion.wire.ids import Policy
from companion.wire.incidents import read_name

FILES = ("large", "check", "calls", "ground")


@dataclass(frozen=True)
class SetPolicyRequest:
    """A policy that the rover shall have."""

    policy: Policy


@dataclass(frozen=True)
class UndoRequest:
    """Takes back what this console answered to a call."""

    call: int


@dataclass(frozen=True)
class FileRequest:
    """Asks for a file that a slow radio does not get by itself. what: one of `FILES`. call: 0 for none."""

    what: str
    call: int


@dataclass(frozen=True)
class IncidentRequest:
    """Has an incident packed on the rover. call: its id, 0: the last minute."""

    call: int


@dataclass(frozen=True)
class IncidentFileRequest:
    """Fetches an incident file that is packed, or stops that. name: of the file."""

    name: str
    stop: bool


Request = Answer | SetPolicyRequest | UndoRequest | FileRequest | IncidentRequest | IncidentFileRequest


def read_request(kind: str, body: bytes) -> tuple[int, Request]:
    """Read the body of a POST to /`kind`: which rover is meant, and what. Raises RequestError."""
    told = read_object(body)
    rover = whole(told, "rover", 1, 255)
    if kind == "answer":
        return rover, read_answer(told)
    if kind == "policy":
        return rover, SetPolicyRequest(_policy(told.get("policy")))
    if kind == "undo":
        return rover, UndoRequest(whole(told, "call", 1, 0xFFFF))
    if kind == "incident":
        return rover, IncidentRequest(read_incident(told))
    if kind == "stop" or (kind == "fetch" and "name" in told):
        name = told.get("name")
        if not isinstance(name, str) or read_name(name) is None:
            raise RequestError("name is that of an incident file")
        return rover, IncidentFileRequest(name, stop=kind == "stop")
    if kind == "fetch":
        what = told.get("what")
        if what not in FILES:
            raise RequestError(f"what is one of {', '.join(FILES)}")
        return rover, FileRequest(what, whole(told, "call", 1, 0xFFFF) if what == "large" else 0)
    raise RequestError("there is no such request")


def _policy(raw: Any) -> Policy:
    try:
        return Policy[str(raw).upper()]
    except KeyError as error:
        names = ", ".join(policy.name.lower() for policy in Policy)
        raise RequestError(f"policy is one of {names}") from error
