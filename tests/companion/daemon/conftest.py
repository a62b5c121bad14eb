"""Daemons in virtual time."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from bench.virtual_time import Clock
from companion.wire.ids import Policy
from tests.companion.daemon.rig import MakeRig, Rig


@pytest.fixture
def make_rig(tmp_path: Path, clock: Clock) -> Iterator[MakeRig]:
    """Rigs that drive over grass in AUTO."""
    made: list[Rig] = []

    def make(policy: Policy = Policy.HOLD, pictures: int = 0, switch: int | None = None) -> Rig:
        rig = Rig(tmp_path, clock, policy, pictures, switch)
        made.append(rig)
        rig.see(1.0)
        return rig

    yield make
    for rig in made:
        rig.kill()


@pytest.fixture
def rig(make_rig: MakeRig) -> Rig:
    """Allowed to hold."""
    return make_rig()


@pytest.fixture
def held(rig: Rig) -> Rig:
    """Standing before a drum that no word explains: call 1."""
    rig.see(3.0, "drum")
    assert rig.state == ("CALLING", 1)
    assert rig.stage.mode == 4
    return rig


@pytest.fixture
def radio() -> Iterator[socket.socket]:
    """A ground that only listens."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ground:
        ground.bind(("127.0.0.1", 0))
        ground.settimeout(0.1)
        yield ground
