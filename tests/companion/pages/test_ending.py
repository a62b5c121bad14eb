"""A server ends soon, whoever still reads from it or does not."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator

import pytest

pytest.importorskip("uvicorn")

from starlette.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from companion.pages.access import _STALLED
from companion.pages.site import Server


async def endless(scope: Scope, receive: Receive, send: Send) -> None:
    """Answer with a stream: /loud as fast as it is taken, /quiet without a byte."""

    async def chunks() -> AsyncIterator[bytes]:
        while True:
            await asyncio.sleep(0)
            if scope["path"] == "/loud":
                yield bytes(1 << 16)
            else:
                await asyncio.sleep(3600)

    await StreamingResponse(chunks())(scope, receive, send)


async def ended_with(path: str, *, stalls: bool) -> None:
    """End a server of which a client has asked for `path`, and takes nothing of it."""
    with socket.socket() as listener, socket.socket() as client:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        client.connect(listener.getsockname())
        client.sendall(f"GET {path} HTTP/1.1\r\nHost: here\r\n\r\n".encode())
        server = Server(endless)
        serving = asyncio.create_task(server.serve(sockets=[listener]))
        while not any(one.flow.write_paused or not stalls for one in server.server_state.connections):
            await asyncio.sleep(0.01)
        server.should_exit = True
        await asyncio.wait_for(serving, _STALLED / 2)
        assert not server.server_state.connections
        assert not server.server_state.tasks


@pytest.mark.parametrize(("path", "stalls"), [("/loud", True), ("/quiet", False)])
def test_a_server_ends_though_a_stream_is_open(path: str, stalls: bool) -> None:
    asyncio.run(asyncio.wait_for(ended_with(path, stalls=stalls), 30.0))
