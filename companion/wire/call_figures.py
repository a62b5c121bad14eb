"""Words the figures for which a call asks, and what they lack, the same for texts, pages and terminal."""

from __future__ import annotations

import math
import re

_ASKED = re.compile(
    r"C([0-9]{1,5}) (?:stays open: )?((?:new place|unknown [0-9])[ -~]*?)(?:: go/(?:stay/)?word)?", re.ASCII
)

_LIGHT = r"(?:, (?P<light>[a-z ]+))?"
_THING = re.compile(
    rf"unknown (?P<share>[0-9]{{1,3}})%(?: in (?P<of>[a-z ]+))?{_LIGHT}, over (?P<most>[0-9]{{1,3}})% calls"
)
_COSINE = r"-?[01]?\.[0-9]{2}"
_PLACE = re.compile(
    rf"new place{_LIGHT}(?:, (?P<value>{_COSINE})(?: like (?P<like>a known one|C[0-9]{{1,5}}))?, "
    rf"(?P<least>{_COSINE}) needed)?"
)


def asked(text: str) -> tuple[int, str] | None:
    """Read a text that says why a call is open: its id and why; None for another text."""
    found = _ASKED.fullmatch(text)
    return (int(found[1]), found[2]) if found else None


def place_figures(similarity: float | None, needed: float | None, like: int | None, light: str = "") -> str:
    """Says how much a place is like a known one, and what it lacks: "new place, .91 like C3, .94 needed".

    light: what is unusual in the picture's light, told in place of the known one: "new place, dark, .91".
    similarity, needed: cosines, "new place" alone where one is not known. like: the call at which the known
    place was answered, 0: it has none, None: not known.
    """
    known = similarity is not None and needed is not None and math.isfinite(similarity + needed)
    new = f"new place, {light}" if light else "new place"
    if not known or similarity is None or needed is None:
        return new
    # Rounded apart, so that what is told never says that it was enough.
    value, least = _hundredths(similarity, up=False), _hundredths(needed, up=True)
    known_as = "" if like is None or light else " like a known one" if not like else f" like C{like}"
    return f"{new}, {value}{known_as}, {least} needed"


def thing_figures(share: float | None, limit: float | None, of: str, light: str = "") -> str:
    """Says how unknown a thing is, and how much calls: "unknown 91% in yellow frame, over 85% calls".

    share, limit: uncertainty in [0, 1], "unknown thing ahead" alone where one is not known. of: the part of
    the picture, "" to leave it out. light: as for `place_figures`, told in place of that.
    """
    if share is None or limit is None or not math.isfinite(share + limit):
        return "unknown thing ahead"
    value, most = _rounded(max(0.0, share), up=True), _rounded(max(0.0, limit), up=False)
    where = f", {light}" if light else f" in {of}" if of else ""
    return f"unknown {value}%{where}, over {most}% calls"


def _rounded(value: float, *, up: bool) -> int:
    """Round a figure in [-1, 1] to hundredths, up or down."""
    hundredths = round(100 * min(1.0, max(-1.0, value)), 6)
    return math.ceil(hundredths) if up else math.floor(hundredths)


def _hundredths(value: float, *, up: bool) -> str:
    """Format a cosine as ".91", up or down."""
    return f"{_rounded(value, up=up) / 100:.2f}".replace("0.", ".")


def thing_in_words(why: str) -> str:
    """Word what `thing_figures` told for a page: "91 % of the yellow frame is unknown, over 25 % calls".

    "" where `why` tells nothing of a thing.
    """
    found = _THING.search(why)
    if found is None:
        return ""
    of = {"region": " of the region", None: ""}.get(found["of"], f" of the {found['of']}")
    return f"{found['share']} %{of} is unknown, over {found['most']} % calls{_in_light(found)}"


def place_in_words(why: str) -> str:
    """Word what `place_figures` told for a page: "0.91 like C3, known from 0.94 on"; "" where it did not.

    The light alone, "dark", where it told no figure.
    """
    found = _PLACE.search(why)
    if found is None:
        return ""
    if found["value"] is None:
        return found["light"] or ""
    like = f"like {found['like'] or 'a known one'}"
    return f"{float(found['value']):.2f} {like}, known from {float(found['least']):.2f} on{_in_light(found)}"


def _in_light(found: re.Match[str]) -> str:
    return f" ({found['light']})" if found["light"] else ""
