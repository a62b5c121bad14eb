"""Makes what a page shows of a call: the rover's own, the console's, that of a rehearsal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from companion.pages import wording
from companion.pages.given import OwnAnswers
from companion.wire.call_report import CallReport, NearestScene, reason_names
from companion.wire.ids import Stage
from companion.wire.packing import clean
from companion.wire.texts import name


def shown(
    call: CallReport,
    own: OwnAnswers,
    *,
    key: str,
    pictures: Mapping[str, str],
    said: Sequence[Mapping[str, Any]],
    nearest: Mapping[str, Any] | None,
    since: float | None = None,
) -> dict[str, Any]:
    """Return what every page shows of a call.

    own: what was answered from the page. key: tells calls of one id apart. pictures: their addresses by size.
    said: what else became of it, time and text. nearest: of `nearest`. since: when it opened, by the page's
    clock, None for one of which only its record tells.
    """
    told: dict[str, Any]
    if since is None:
        told = {"outcome": wording.OUTCOMES[call.outcome]}
    else:
        told = {
            "since": round(since, 2),
            "test": call.test,
            "todo": wording.what_to_do(call),
            "stands": wording.stands(call),
            "holding": call.holding,
            "frame": call.frame_id,
            "roi": call.roi,
        }
    return {
        "id": call.id,
        "key": key,
        "name": name(call.kind, call.id),
        "kind": call.kind.name.lower(),
        "stage": call.stage.name.lower(),
        "open": call.stage is not Stage.CLOSED,
        "reasons": reason_names(call.reasons),
        "reason": wording.reason(call),
        "figures": wording.figures(call),
        "box": call.worst_tile_box if wording.points(call) else None,
        "pictures": pictures,
        "said": said,
        "nearest": nearest,
        **told,
        **own.document(),
    }


def nearest(found: NearestScene, said: str, motion: str, alike: float | None, picture: str) -> dict[str, Any]:
    """Tell which answered scene a call's is most like, and what the answer was.

    said: who answered, for a person. motion: of that answer, "" where it is not known. alike: the similarity
    from which two scenes count as one. picture: its address, "" for none.
    """
    words = ", ".join(f"{word} {weight:g}" for word, weight in found.words.items())
    answer = ", ".join(filter(None, (words, motion))) or "go"
    there = f"call C{found.call_id}" if found.call_id else "a place that another rover learnt"
    far = alike is not None and found.similarity < alike
    most = "Not much like any place that was answered; nearest is" if far else "Most like"
    return {
        "call": found.call_id,
        "similarity": round(found.similarity, 2),
        "words": [[word, weight] for word, weight in found.words.items()],
        "alike": not far,
        "text": clean(f"{most} {there} ({found.similarity:.2f}): {said} {answer}."),
        "picture": picture,
    }
