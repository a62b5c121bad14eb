"""Makes what a page shows of a call and its incident files: the rover's own, the console's, a rehearsal's."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from anytraverse.operations import taps_of
from companion.pages import wording
from companion.pages.given import OwnAnswers
from companion.wire.call_report import CallReport, NearestScene, reason_names
from companion.wire.delivery import Pending
from companion.wire.ids import Kind, Reasons, Stage
from companion.wire.incidents import SHORT, Incidents
from companion.wire.packing import clean
from companion.wire.texts import name

_POSTED_MOTIONS = {"go": "go", "stay": "stay", "look_again": "look"}
_AND = {"go": ", and go", "stay": ", and stay", "look": ", and look again", "none": ""}
_KINDS = {SHORT: "the short file", "": "the whole file"}


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
        "known": known_thing(call, nearest),
        **told,
        **own.document(),
    }


def known_thing(call: CallReport, nearest: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Return what a thing was named in the scene most like a call's, to be answered at once.

    nearest: of `nearest`. word, weight, motion: of a tap in the call's box. None where the call asks about no
    thing, or where nobody knows whether one was named there.
    """
    asks = call.stage is Stage.OPEN and call.kind is Kind.CALL and not call.test and wording.points(call)
    if not asks or not call.reasons & Reasons.UNKNOWN_OBJECT or nearest is None or not nearest["alike"]:
        return None
    thing: dict[str, Any] | None = nearest["named"]
    if thing is None:
        return None
    weight = ("\N{MINUS SIGN}" if thing["weight"] else "") + f"{abs(thing['weight']):g}"
    there = f"you named at C{nearest['call']}: {weight}{_AND[thing['motion']]}"
    return {**thing, "text": clean(f"Still the {thing['word']} {there}")}


def named_thing(own: OwnAnswers, record: CallReport | None) -> dict[str, Any] | None:
    """Return what the newest answer to a call named a thing that is not drivable, and its motion.

    A thing is named by a tap: a word without one is said of all the ground. None where none was.
    """
    applied = [one.pending.answer for one in own.answers if one.pending.applied]
    answers = [({tap.word: tap.weight for tap in taps_of(one.changes)}, one.motion.name) for one in applied]
    if not answers and record is not None:
        answers = [(wording.tapped(one), one.motion) for one in record.answers if wording.applied(one)]
    for words, motion in reversed(answers):
        for word, weight in words.items():
            if weight <= 0:
                posted = _POSTED_MOTIONS.get(motion.lower(), "none")
                return {"word": word, "weight": weight, "motion": posted}
    return None


def nearest(
    found: NearestScene,
    said: str,
    motion: str,
    alike: float | None,
    picture: str,
    named: Mapping[str, Any] | None,
) -> dict[str, Any]:
    """Tell which answered scene a call's is most like, and what the answer was.

    said: who answered, for a person. motion: of that answer, "" where it is not known. alike: the similarity
    from which two scenes count as one. picture: its address, "" for none. named: `named_thing` there.
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
        "named": named,
        "text": clean(f"{most} {there} ({found.similarity:.2f}): {said} {answer}."),
        "picture": picture,
    }


def incident_shown(
    told: Incidents, call: int, asked: Pending | None, more: Callable[[str, int], dict[str, Any]]
) -> dict[str, Any]:
    """Return what a page shows of the incident files of a call; 0: of the last minute.

    told: by the rover. asked: the newest request for it from this page, None without one. more: returns how a
    file of this name and of so many bytes can be had: "url", or how it is fetched.
    """
    newest, failed = told.newest(call), told.failed
    packing, waits = told.packing == call, asked is not None and not asked.settled
    texts = []
    if failed is not None and failed[0] == call:
        texts.append(f"It could not be packed: {failed[1]}.")
    if asked is not None and not packing and not asked.applied:
        texts.append(f"The request: {asked.told}.")
    if packing:
        texts.append("It is being packed.")
    files = []
    if newest is not None and not packing:
        texts += [f"It is {newest.note}."] if newest.note else []
        for kind, size in ((SHORT, newest.short), ("", newest.size)):
            name = f"{newest.name}{kind}.zip"
            files.append({"name": name, "what": _KINDS[kind], "bytes": size, **more(name, size)})
    return {"text": " ".join(texts), "busy": packing or waits, "packing": packing, "files": files}
