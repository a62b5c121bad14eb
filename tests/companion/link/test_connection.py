from itertools import pairwise

from companion.link.connection import Connection
from companion.link.transport import Transport
from companion.sim.loopback_link import MemoryTransport, pair


class Socket:
    """A device that is there or not; counts how often it was tried."""

    def __init__(self, *, there: bool) -> None:
        self.there = there
        self.tried: list[float] = []
        self.now = 0.0
        self.near, self.far = pair()

    def open(self) -> Transport:
        self.tried.append(self.now)
        if not self.there:
            raise FileNotFoundError(2, "no such device")
        self.near = MemoryTransport()
        return self.near

    def live(self, connection: Connection, seconds: float) -> None:
        for _ in range(round(seconds * 10)):
            connection.read(self.now)
            self.now = round(self.now + 0.1, 3)


def test_a_device_that_is_absent_is_looked_for_twice_a_second_however_long() -> None:
    socket = Socket(there=False)
    connection = Connection(socket.open, 0.0)
    socket.live(connection, 40.0)
    assert {round(b - a, 1) for a, b in pairwise(socket.tried)} == {0.5}
    assert connection.trouble == "no such device"
    assert connection.fileno() is None
    assert not connection.write(b"frame", socket.now)


def test_it_is_opened_when_it_appears() -> None:
    socket = Socket(there=False)
    connection = Connection(socket.open, 0.0)
    socket.live(connection, 1.0)
    socket.there = True
    socket.live(connection, 2.0)
    assert connection.opened == 1
    assert connection.write(b"frame", socket.now)


def test_a_device_that_is_pulled_out_is_opened_again() -> None:
    socket = Socket(there=True)
    connection = Connection(socket.open, 0.0)
    socket.live(connection, 1.0)
    socket.near.broken = True
    assert not connection.write(b"frame", socket.now)
    assert connection.trouble == "unplugged"
    socket.live(connection, 2.0)
    assert connection.opened == 2
    assert connection.write(b"frame", socket.now)


def test_a_device_that_broke_again_and_again_is_back_half_a_second_after_it_was_plugged_in_again() -> None:
    socket = Socket(there=True)
    connection = Connection(socket.open, 0.0)
    for _ in range(200):
        connection.read(socket.now)
        socket.near.broken = True
        connection.read(socket.now)
        socket.now += 0.1
    socket.there = False
    socket.live(connection, 10.0)
    socket.there, tried = True, len(socket.tried)
    socket.live(connection, 0.6)
    assert len(socket.tried) == tried + 1
    assert connection.write(b"frame", socket.now)


def test_a_device_that_opens_and_breaks_at_once_is_not_hammered() -> None:
    socket = Socket(there=True)
    connection = Connection(socket.open, 0.0)
    for _ in range(300):
        connection.read(socket.now)
        socket.near.broken = True
        connection.read(socket.now)
        socket.now += 0.1
    assert connection.opened <= 9


def test_after_bytes_were_read_the_next_retry_is_quick_again() -> None:
    near, far = pair()
    connection = Connection(lambda: near, 0.0)
    connection.read(0.0)
    near.broken = True
    connection.read(0.1)
    near.broken = False
    connection.read(0.7)
    far.write(b"x")
    assert connection.read(0.8) == b"x"
    assert connection.trouble is None
