"""The whole process over real sockets, as a companion, a ground station and an onlooker meet it."""

from __future__ import annotations

import contextlib
import json
import math
import os
import selectors
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import development as mavlink

from companion.cameras.field import FrameStream, FrameTimeout
from companion.sim.field.__main__ import main
from companion.sim.field.control import FieldControl
from companion.sim.field.router import DatagramParser

pytest.importorskip("cv2", reason="the field draws with OpenCV")

SMALL = ("--width", "64", "--height", "48", "--fps", "20")
PATIENCE = 20.0


def start(*options: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", "companion.sim.field", *SMALL, *options],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
    )


def first_line(process: subprocess.Popen[bytes]) -> dict[str, Any]:
    assert process.stdout is not None
    with selectors.DefaultSelector() as selector:
        selector.register(process.stdout, selectors.EVENT_READ)
        assert selector.select(PATIENCE), "the process said nothing"
    return dict(json.loads(process.stdout.readline()))


def end(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    process.wait()
    if process.stdout is not None:
        process.stdout.close()


@pytest.fixture(scope="module")
def addresses() -> Iterator[dict[str, Any]]:
    process = start("--seed", "2", "--no-script")
    try:
        yield first_line(process)
    finally:
        end(process)


@pytest.fixture
def control(addresses: dict[str, Any]) -> Iterator[FieldControl]:
    with FieldControl(*host_and_port(addresses["control"])) as control:
        yield control


def host_and_port(address: str) -> tuple[str, int]:
    host, port = address.removeprefix("udpout:").rsplit(":", 1)
    return host, int(port)


class Peer:
    """A MAVLink component on one of the two ports."""

    def __init__(self, address: str, system: int, component: int) -> None:
        self.mav = mavlink.MAVLink(None, system, component)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(host_and_port(address))

    def __enter__(self) -> Peer:
        self.tell(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def tell(self, message: Any) -> bytes:
        raw = bytes(message.pack(self.mav))
        self._socket.send(raw)
        return raw

    def tell_raw(self, datagram: bytes) -> None:
        self._socket.send(datagram)

    def hear(self, wanted: Callable[[Any], bool], timeout: float = 5.0) -> Any:
        """The first frame that is wanted, or None."""
        deadline = time.monotonic() + timeout
        while (left := deadline - time.monotonic()) > 0:
            self._socket.settimeout(left)
            with contextlib.suppress(TimeoutError):
                for frame in DatagramParser().frames(self._socket.recv(4096)):
                    if wanted(frame):
                        return frame
        return None


def kind(name: str) -> Callable[[Any], bool]:
    return lambda frame: bool(frame.get_type() == name)


@pytest.fixture
def rover(addresses: dict[str, Any]) -> Iterator[Peer]:
    with Peer(addresses["companion"], 1, 191) as peer:
        assert peer.hear(kind("ATTITUDE"))
        yield peer


@pytest.fixture
def ground(addresses: dict[str, Any]) -> Iterator[Peer]:
    with Peer(addresses["gcs"], 255, 190) as peer:
        assert peer.hear(kind("ATTITUDE"))
        yield peer


def test_the_first_line_names_every_address_and_the_seed(addresses: dict[str, Any]) -> None:
    assert sorted(addresses) == ["companion", "control", "frames", "gcs", "script", "seed"]
    assert addresses["seed"] == 2
    ports = {host_and_port(addresses[name])[1] for name in ("companion", "gcs", "frames", "control")}
    assert len(ports) == 4


def test_a_ground_station_that_never_spoke_is_sent_nothing() -> None:
    process = start()
    try:
        addresses = first_line(process)
        with (
            Peer(addresses["companion"], 1, 191) as rover,
            FieldControl(*host_and_port(addresses["control"])) as control,
        ):
            assert rover.hear(kind("ATTITUDE"))
            rover.tell(mavlink.MAVLink_statustext_message(3, b"anybody there?"))
            assert rover.hear(kind("ATTITUDE"))
            counts = control.status()["bytes"]
            assert counts["companion"]["out"] > 0
            assert counts["gcs"] == {"in": 0, "out": 0, "from_companion": 0}
    finally:
        end(process)


def test_rubbish_on_either_port_stops_nothing(rover: Peer, ground: Peer) -> None:
    noise = bytes(range(256)) * 4
    for peer in (rover, ground):
        for datagram in (b"", b"\xfd", b"\xfe\xff", noise, b"\xfd\xff\x01" + noise):
            peer.tell_raw(datagram)
    for peer in (rover, ground):
        assert peer.hear(kind("HEARTBEAT"), timeout=3.0)


def test_a_pymavlink_client_reads_lists_and_sets_parameters(addresses: dict[str, Any]) -> None:
    client = mavutil.mavlink_connection(addresses["gcs"], source_system=254, source_component=190)
    with contextlib.closing(client):
        client.mav.heartbeat_send(6, 8, 0, 0, 4)
        assert client.wait_heartbeat(timeout=5) is not None
        client.mav.param_request_list_send(1, 1)
        names: dict[int, str] = {}
        count = 1
        while len(names) < count:
            row = client.recv_match(type="PARAM_VALUE", blocking=True, timeout=5)
            assert row is not None
            names[row.param_index], count = row.param_id, row.param_count
        assert "MIS_RESTART" in names.values()
        client.mav.param_set_send(1, 1, b"CRUISE_SPEED", 2.0, 9)
        echo = client.recv_match(type="PARAM_VALUE", blocking=True, timeout=5)
        assert (echo.param_id, echo.param_value) == ("CRUISE_SPEED", 2.0)


def test_frames_come_in_order_and_stop_while_the_camera_is_frozen(
    addresses: dict[str, Any], control: FieldControl, ground: Peer
) -> None:
    with FrameStream(*host_and_port(addresses["frames"])) as stream:
        frames = [stream.read(timeout=5.0) for _ in range(5)]
        ids, times = [frame.id for frame in frames], [frame.captured_at for frame in frames]
        assert (ids, times) == (sorted(set(ids)), sorted(set(times)))
        assert frames[0].rgb.shape == (48, 64, 3)
        assert 0.0 <= time.monotonic() - frames[-1].captured_at < 1.0
        control.ask("freeze_camera", on=True)
        assert no_more_than(2, stream)
        assert ground.hear(kind("HEARTBEAT"), timeout=3.0)
        control.ask("freeze_camera", on=False)
        assert stream.read(timeout=5.0).id > frames[-1].id


def no_more_than(count: int, stream: FrameStream) -> bool:
    """A frame may be under way when the camera freezes."""
    with contextlib.suppress(FrameTimeout):
        for _ in range(count + 1):
            stream.read(timeout=0.5)
        return False
    return True


def test_a_rover_that_is_to_lean_says_so_and_still_films() -> None:
    leans = "--swing=5", "--bumps=3", "--slopes=6", "--distortion=-0.1"
    process = start(*leans, "--autostart", "--no-script")
    try:
        addresses = first_line(process)
        with (
            Peer(addresses["companion"], 1, 191) as rover,
            FieldControl(*host_and_port(addresses["control"])) as control,
            FrameStream(*host_and_port(addresses["frames"])) as stream,
        ):
            moving = rover.hear(lambda frame: kind("ATTITUDE")(frame) and abs(frame.pitchspeed) > 0.02)
            assert abs(moving.pitch) < math.radians(5 + 3 + 6)
            assert {"pitch", "roll", "slope_ahead"} < control.status().keys()
            assert stream.read(timeout=5.0).rgb.shape == (48, 64, 3)
    finally:
        end(process)


def test_the_stop_request_ends_the_process_cleanly() -> None:
    process = start()
    try:
        with FieldControl(*host_and_port(first_line(process)["control"])) as control:
            control.stop()
        assert process.wait(PATIENCE) == 0
    finally:
        end(process)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_the_process_cleanly(number: signal.Signals) -> None:
    process = start()
    try:
        first_line(process)
        process.send_signal(number)
        assert process.wait(PATIENCE) == 0
    finally:
        end(process)


def test_it_runs_for_its_time_even_when_nobody_reads_what_it_says() -> None:
    reader, writer = os.pipe()
    os.close(reader)
    process = subprocess.Popen(
        [sys.executable, "-m", "companion.sim.field", *SMALL, "--duration", "0.5"],
        stdin=subprocess.DEVNULL,
        stdout=writer,
        stderr=subprocess.PIPE,
    )
    os.close(writer)
    _, conflicts = process.communicate(timeout=PATIENCE)
    assert (process.returncode, conflicts) == (0, b"")


@pytest.mark.parametrize(
    "option",
    [
        ("--fps", "0"),
        ("--speed", "-1"),
        ("--width", "1"),
        ("--seed", "x"),
        ("--swing", "11"),
        ("--bumps", "-1"),
        ("--slopes", "13"),
        ("--distortion", "-0.5"),
    ],
)
def test_an_option_out_of_range_is_refused_by_name(
    option: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(option)
    assert option[0] in capsys.readouterr().err


def test_it_says_whether_the_script_for_the_autopilot_runs(addresses: dict[str, Any]) -> None:
    pytest.importorskip("lupa.lua53", reason="the script runs in Lua 5.3")
    assert addresses["script"] == "not running: --no-script"
    process = start()
    try:
        assert first_line(process)["script"] == "running"
    finally:
        end(process)
