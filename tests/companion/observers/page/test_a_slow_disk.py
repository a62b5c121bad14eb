"""A disk that hangs costs those who ask for files, and nobody else."""

from __future__ import annotations

import asyncio
import threading
from pathlib import Path

import pytest

pytest.importorskip("starlette")

from starlette.responses import PlainTextResponse, Response

from companion.observers.page import server
from companion.observers.page.files import StateFolder
from companion.observers.page.news import News


def test_only_so_many_wait_for_a_disk_that_hangs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "_DISK_PATIENCE", 0.2)
    answers = threading.Event()

    def read() -> str:
        answers.wait(10.0)
        return "read"

    async def ask(site: server.PageSite) -> Response:
        return await site._read(read, PlainTextResponse)

    async def asked() -> None:
        site = server.PageSite(News(), StateFolder(str(tmp_path)))
        first = await asyncio.gather(*(ask(site) for _ in range(server.MOST_READING + 4)))
        texts = [bytes(one.body) for one in first]
        assert [one.status_code for one in first] == [503] * len(first)
        assert texts.count(b"the disk cannot be read: too much waits for it: ask again later\n") == 4
        assert (await ask(site)).status_code == 503
        answers.set()
        for _ in range(100):
            if (again := await ask(site)).status_code == 200:
                break
            await asyncio.sleep(0.02)
        assert again.body == b"read"

    asyncio.run(asked())
