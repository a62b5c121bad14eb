"""Whom a UDP port answers that is bound and knows nobody."""

from __future__ import annotations

import math
from collections.abc import Iterator

from companion.link.leases import Leases

MAX_PEERS = 4
KEPT = 10.0
"""s without a believed frame after which another may take an address's place."""

Peer = tuple[str, int]
"""Address and port."""


class Peers:
    """The autopilot's address, and at most four others: only those from which a frame was believed.

    The address from which the autopilot was heard first stays its own while it is still heard there. Another
    one that speaks in its name is answered where there is room, and makes room for anybody else.
    """

    def __init__(self) -> None:
        self._autopilot: Leases[Peer, None] = Leases(1, KEPT)
        self._others: Leases[Peer, None] = Leases(MAX_PEERS, KEPT)

    def __iter__(self) -> Iterator[Peer]:
        return iter(dict.fromkeys((*self._autopilot, *self._others)))

    def believe(self, peer: Peer, now: float, *, autopilot: bool) -> None:
        """A frame from `peer` was believed; autopilot: it was our autopilot's."""
        if not (autopilot and self._autopilot.renew(peer, None, now)):
            self._others.renew(peer, None, -math.inf if autopilot else now)
