"""A ground station's end of a network."""

import socket
from collections.abc import Iterator

import pytest


@pytest.fixture
def ground() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ground:
        ground.bind(("127.0.0.1", 0))
        ground.settimeout(0)
        yield ground
