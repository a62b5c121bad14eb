"""A real web process passes answers on, from those who have the token only."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from anytraverse.operations import SetWord
from companion.observers.page.messages import LONGEST_SAID
from companion.observers.page.page import WebChild, missing
from companion.wire.answers import Acknowledgement, Answer
from companion.wire.ids import Motion, Result
from tests.companion.observers.page.played import TOKEN, Stage
from tests.companion.observers.page.test_a_page_that_fails import SAYS

pytestmark = pytest.mark.skipif(bool(missing()), reason="the extra web is not installed")
GO = {"call": 7, "motion": "go", "changes": [{"word": "gravel", "weight": 1}]}
BEARER = {"authorization": f"Bearer {TOKEN}"}


@pytest.fixture(scope="module")
def answered(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Stage, list[bytes]]]:
    """A page with a token and an open call, and the payloads that its supervisor was given."""
    folder: Path = tmp_path_factory.mktemp("state")
    (folder / "calls").mkdir()
    stage, given = Stage(folder, token=TOKEN), list[bytes]()
    stage.page.answer = lambda payload, _at: given.append(payload)
    opened = {"id": 7, "kind": "call", "stage": "open", "frame_id": 9, "age": 3, "holding": True}
    stage.news["state"] |= {"open": opened, "words": {"grass": 1.0}}
    stage.until(lambda: stage.up() and stage.get("/healthz", headers=BEARER).status == 200)
    yield stage, given
    stage.close()


def test_an_answer_reaches_the_supervisor_and_its_acknowledgement_the_page(
    answered: tuple[Stage, list[bytes]],
) -> None:
    stage, given = answered
    given.clear()
    posted = stage.post("/answer", GO)
    assert (posted.status, json.loads(posted.body)) == (200, {"done": "sent"})
    stage.until(lambda: bool(given))
    message = Answer.unpack(given[0])[0]
    assert (message.target, message.motion, message.operations) == (7, Motion.GO, (SetWord("gravel", 1.0),))

    def shown() -> dict[str, str]:
        (call,) = json.loads(stage.get("/shown-calls.json", headers=BEARER).body)["calls"]
        (one,) = call["answers"]
        return {name: one[name] for name in ("said", "text", "tone")}

    assert shown() == {"said": "gravel: 1, go", "text": "sent", "tone": "wait"}
    stage.page.acknowledge(
        Acknowledgement.without_figures(message.transaction, 7, Result.APPLIED, "C7 waits")
    )
    stage.until(lambda: shown()["tone"] == "good")
    assert shown()["text"] == "done: C7 waits"
    stage.until(lambda: len(given) == 1 or pytest.fail("it was sent again"), 1.0)


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"authorization": "Bearer wrong-wrong-wrong"}, 401),
        ({"origin": "http://elsewhere"}, 403),
        ({"sec-fetch-site": "same-site"}, 403),
        ({"content-type": "text/plain"}, 415),
    ],
)
def test_who_may_not_answer_is_refused(
    answered: tuple[Stage, list[bytes]], headers: dict[str, str], status: int
) -> None:
    stage, given = answered
    given.clear()
    assert stage.post("/answer", GO, headers).status == status
    stage.until(lambda: True)
    assert given == []


def test_what_is_no_answer_is_refused_with_a_reason(answered: tuple[Stage, list[bytes]]) -> None:
    stage, _ = answered
    refused = stage.post("/answer", {"call": 8, "motion": "go"})
    assert (refused.status, json.loads(refused.body)["problem"]) == (
        409,
        "call 8 is closed already, so nothing was sent",
    )
    assert stage.post("/answer", {"x": "y" * 20_000}).status == 413
    assert stage.post("/undo", {"call": 9}).status == 409
    assert stage.post("/policy", {"policy": "off"}).status == 404


def test_without_a_token_nothing_is_taken(stage: Stage) -> None:
    assert stage.post("/answer", GO).status == 405
    assert stage.post("/undo", {"call": 7}).status == 405


@pytest.mark.parametrize(
    ("token", "said"), [("", "s.send(b'r' + bytes(20))"), (TOKEN, f"s.send(b'r' * {LONGEST_SAID + 1})")]
)
def test_a_process_that_answers_without_a_token_or_says_too_much_is_killed(
    tmp_path: Path, token: str, said: str
) -> None:
    command = (sys.executable, "-c", SAYS.format(said))
    stage = Stage(tmp_path, token=token, launch=lambda listener: WebChild(listener, command))
    given = list[bytes]()
    stage.page.answer = lambda payload, _at: given.append(payload)
    try:
        stage.until(lambda: stage.page.figures()["restarts"] >= 1)
        assert given == []
    finally:
        stage.close()
