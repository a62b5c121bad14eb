"""The settings of the MAVLink connection."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from companion.config.checks import checked, listing, number, whole
from companion.config.section import Complaint, Section, setting
from companion.link.settings import LinkSettings


@dataclass(frozen=True)
class Link(Section):
    """MAVLink."""

    url: str = setting(
        "udpin:127.0.0.1:14550",
        checked(LinkSettings),
        "udpin:host:port, udpout:host:port, tcp:host:port or serial:device:baud",
    )
    system_id: int = setting(1, whole(1, 254), "ours until the autopilot's is known")
    budget: float = setting(300.0, number(0, 1e6), "bytes/s of unsolicited traffic, 0 unlimited")
    burst: float = setting(600.0, number(300, 1e6), "bytes at once")
    asked_budget: float = setting(1500.0, number(0, 1e6), "bytes/s of what somebody asked for, 0 unlimited")
    pace: float = setting(0.03, number(0, 1), "least s between frames; 0.05 behind PX4")
    allowed_senders: tuple[int, int] = setting(
        (245, 255), listing(whole(1, 255), 2, 2), "first and last system id that may change anything"
    )

    def complaints(self) -> Iterator[Complaint]:
        try:
            self.settings()
        except ValueError as error:
            keys = [key for key in ("budget", "asked_budget", "allowed_senders") if key in str(error)]
            yield tuple(keys) or ("url",), str(error)

    def settings(self) -> LinkSettings:
        """As the link takes them."""
        return LinkSettings(
            url=self.url,
            system_id=self.system_id,
            budget=self.budget,
            burst=self.burst,
            asked_budget=self.asked_budget,
            pace=self.pace,
            allowed_senders=self.allowed_senders,
        )
