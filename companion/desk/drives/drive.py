"""What a drive is: frames with their times, none left out."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

from anytraverse.frame import Frame, Image, Pose
from anytraverse.history import Place


class DriveError(Exception):
    """Reports a drive that cannot be read. The text says what to do."""


@dataclass(frozen=True)
class DriveFrame:
    """A frame. name: of its file, or its time in a video. at: seconds of the drive.

    decode: returns the picture. place, travelled: where the vehicle was, and the metres that it had driven,
    as far as known. lean, pose, reach: as in `Frame`.
    """

    name: str
    at: float
    decode: Callable[[], Image | None]
    place: Place = field(default_factory=Place)
    travelled: float | None = None
    lean: tuple[float, float] | None = None
    pose: Pose | None = None
    reach: float | None = None

    def numbered(self, number: int) -> Frame:
        """Return it as a camera's frame of this id. Only for one that is not torn."""
        assert self.image is not None
        return Frame(number, self.at, self.image, lean=self.lean, pose=self.pose, reach=self.reach)

    @cached_property
    def image(self) -> Image | None:
        """RGB (height, width, 3) uint8, decoded when it is first asked for; None where it is torn."""
        return self.decode()


class Drive(Protocol):
    """A drive. title: for a person. count: how many frames it has, about."""

    title: str
    count: int

    def frames(self) -> Iterator[DriveFrame]:
        """Read all frames in their order."""
        ...


def printable(name: str) -> str:
    """Return a file's name as one line of text that can be encoded: answers.txt and tuned.toml have it."""
    return "".join(one if one.isprintable() else f"\\x{ord(one):02x}" for one in name).strip()
