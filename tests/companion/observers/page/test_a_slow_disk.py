"""A disk that hangs costs those who ask for files, and nobody else."""

from __future__ import annotations

import asyncio
import threading
from pathlib import Path

import pytest

pytest.importorskip("starlette")

from starlette.responses import PlainTextResponse, Response

from companion.observers.page import disk
from companion.observers.page.disk import Disk


def test_only_so_many_wait_for_a_disk_that_hangs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(disk, "PATIENCE", 0.2)
    answers = threading.Event()

    def read() -> str:
        answers.wait(10.0)
        return "read"

    async def ask(site: Disk) -> Response:
        return await site.answer(read, PlainTextResponse)

    async def asked() -> None:
        site = Disk(2)
        first = await asyncio.gather(*(ask(site) for _ in range(disk.MOST_READING + 4)))
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


def test_a_download_goes_on_while_others_keep_the_disk_busy(tmp_path: Path) -> None:
    path = tmp_path / "000001.mcap"
    path.write_bytes(b"x" * (1 << 20))
    over = threading.Event()

    async def fetched() -> int:
        site, got = Disk(1, 2), 0
        file = path.open("rb")
        busy = [
            asyncio.create_task(site.answer(lambda: str(over.wait(10.0)), PlainTextResponse))
            for _ in range(4)
        ]
        await asyncio.sleep(0)
        async for piece in site._pieces(file, 1 << 20):
            got += len(piece)
        over.set()
        await asyncio.gather(*busy)
        return got

    assert asyncio.run(fetched()) == 1 << 20
