"""Names incident files, and reads /incidents.json, which tells of them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, NamedTuple

from companion.wire.ids import Kind
from companion.wire.json_values import list_of, mapping_of, number_of, read_object, text_of
from companion.wire.packing import clean
from companion.wire.texts import name

FOLDER = "incidents"
DOCUMENT = "incidents.json"
LAST_S = 60.0
"""Seconds of a file that is about no call: the last minute."""
MOST_KEPT = 4
"""Incidents whose files stay on the rover's disk, the newest ones."""
MOST_MEMBERS = 200
"""Files in one zip."""
SHORT = "-short"
"""What the name of the short file has more than that of the whole one."""
MOST_NUMBER = 999_999_999
"""Of a recording."""
_NAME = re.compile(r"([0-9]{4,9})-(?:C([0-9]{1,5})|R([1-9][0-9]{0,8})|last)", re.ASCII)
_FILE = re.compile(rf"({_NAME.pattern})({SHORT})?\.zip", re.ASCII)


class Packed(NamedTuple):
    """An incident that was packed, in two files.

    number: rises by one from incident to incident, so that a name never means another content.
    call: id of the call or hold, 0: the last minute, -N: the recording of number N. size, short: bytes of the
    whole file, and of the short one. note: what is missing in it, for a person; "" where nothing is.
    """

    number: int
    call: int
    size: int
    short: int
    note: str = ""

    @property
    def name(self) -> str:
        """The whole file's name without its ending."""
        return name_of(self.number, self.call)

    def document(self) -> dict[str, Any]:
        """Return it as JSON values."""
        return {"name": self.name, "bytes": self.size, "short": self.short, "note": self.note}


class Incidents(NamedTuple):
    """What a rover tells of its incident files.

    packing: what is being packed, as `Packed.call` has it, None for nothing. failed: the call that could
    not be packed last, and why; None after one that could. packed: the newest first.
    """

    packing: int | None = None
    failed: tuple[int, str] | None = None
    packed: tuple[Packed, ...] = ()

    def newest(self, call: int) -> Packed | None:
        """Return the newest incident of a call, None where there is none."""
        return next((one for one in self.packed if one.call == call), None)

    def document(self) -> dict[str, Any]:
        """Return the content of /incidents.json."""
        return {
            "packing": None if self.packing is None else about(self.packing),
            "failed": None if self.failed is None else {"what": about(self.failed[0]), "why": self.failed[1]},
            "packed": [one.document() for one in self.packed],
        }


def about(call: int) -> str:
    """Return what an incident is about, as its files' names have it. call: as of `Packed`."""
    if call < 0:
        return f"R{-call}"
    return name(Kind.CALL, call) if call else "last"


def name_of(number: int, call: int) -> str:
    """Return the name of an incident's whole file without its ending."""
    return f"{number:04d}-{about(call)}"


def read_name(file: str) -> tuple[int, int, bool] | None:
    """Return number, call and whether it is the short one, of a file's name; None for any other name."""
    found = _FILE.fullmatch(file)
    if found is None:
        return None
    return int(found[2]), _about(found[3], found[4]), found[5] is not None


def read_incidents(content: bytes) -> Incidents:
    """Read /incidents.json. Raises DocumentError."""
    return incidents_from(read_object(content))


def incidents_from(told: Mapping[str, Any]) -> Incidents:
    """Take the content of /incidents.json. What is not understood is left out."""
    failed = mapping_of(told.get("failed"))
    about_failed, why = _call(failed.get("what")), clean(text_of(failed.get("why")))
    rows = (packed_from(mapping_of(one)) for one in list_of(told.get("packed"))[: 2 * MOST_KEPT])
    return Incidents(
        _call(told.get("packing")),
        None if about_failed is None or not why else (about_failed, why),
        tuple(one for one in rows if one is not None),
    )


def _call(raw: Any) -> int | None:
    found = _NAME.fullmatch(f"0000-{text_of(raw)}")
    return _about(found[2], found[3]) if found else None


def _about(call: str | None, recording: str | None) -> int:
    """Return what a name is about, as `Packed.call` has it."""
    return -int(recording) if recording else int(call or 0)


def packed_from(told: Mapping[str, Any]) -> Packed | None:
    """Take what `Packed.document` returned, None for anything else."""
    found = _NAME.fullmatch(text_of(told.get("name")))
    size, short = (number_of(told.get(key), 0, 1e12) for key in ("bytes", "short"))
    if found is None or size is None or short is None:
        return None
    return Packed(
        int(found[1]), _about(found[2], found[3]), int(size), int(short), clean(text_of(told.get("note")))
    )
