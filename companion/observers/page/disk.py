"""Answers requests with what the disk has, in threads, and with an error where it is slow or fails."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator, Callable
from concurrent.futures import Future, ThreadPoolExecutor
from threading import BoundedSemaphore
from typing import BinaryIO, TypeVar

from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse

PATIENCE = 5.0
"""Seconds."""
MOST_READING = 16
"""Requests that may wait for the disk."""
MOST_DOWNLOADS = 4
"""Files that are fetched at once."""
_PIECE = 64 << 10
_T = TypeVar("_T")


def no_file() -> Response:
    """Answer to a request for a file that there is not."""
    return PlainTextResponse("there is no such file\n", 404)


class Disk:
    """Reads in threads of its own. No more than `most` requests wait for them.

    Downloads have others: a download must not break where many ask for something else.
    """

    def __init__(self, threads: int, most: int = MOST_READING) -> None:
        self._threads = ThreadPoolExecutor(threads, "disk")
        self._reading = BoundedSemaphore(most)
        self._fetching = ThreadPoolExecutor(MOST_DOWNLOADS, "download")
        self._downloads = 0

    async def answer(self, read: Callable[[], _T], shown: Callable[[_T], Response]) -> Response:
        """Answer with what `read` returns: 404 without such a file, 503 from a disk that is slow or fails."""
        try:
            return shown(await self._from_disk(read))
        except FileNotFoundError:
            return no_file()
        except (OSError, TimeoutError, asyncio.TimeoutError) as error:
            return PlainTextResponse(f"the disk cannot be read: {error or 'it is slow'}\n", 503)

    async def download(
        self, request: Request, read: Callable[[], tuple[str, BinaryIO]], kind: str
    ) -> Response:
        """Answer with a file, piece by piece: it may be larger than this process.

        read: opens it, and returns under which name it is saved. kind: its media type.
        """
        if self._downloads >= MOST_DOWNLOADS:
            return PlainTextResponse(f"{MOST_DOWNLOADS} files are being fetched: ask again later\n", 503)

        def shown(found: tuple[str, BinaryIO]) -> Response:
            name, file = found
            size = os.fstat(file.fileno()).st_size
            headers = {
                "content-disposition": f'attachment; filename="{name}"',
                "content-length": str(size),
            }
            if request.method == "HEAD":
                file.close()
                return Response(headers=headers, media_type=kind)
            return StreamingResponse(self._pieces(file, size), headers=headers, media_type=kind)

        return await self.answer(read, shown)

    async def _pieces(self, file: BinaryIO, left: int) -> AsyncIterator[bytes]:
        """Yield the first bytes of a file, which may grow meanwhile."""
        self._downloads += 1
        try:
            while left and (piece := await self._piece(file, min(left, _PIECE))):
                left -= len(piece)
                yield piece
        finally:
            self._downloads -= 1
            file.close()

    async def _piece(self, file: BinaryIO, most: int) -> bytes:
        return await _in_time(self._fetching.submit(file.read, most))

    async def _from_disk(self, read: Callable[[], _T]) -> _T:
        """Read in a thread. Raises TimeoutError of a disk that is slow, and what `read` raises."""
        if not self._reading.acquire(blocking=False):
            raise TimeoutError("too much waits for it: ask again later")
        running = self._threads.submit(read)
        running.add_done_callback(lambda _: self._reading.release())
        return await _in_time(running)


async def _in_time(running: Future[_T]) -> _T:
    return await asyncio.wait_for(asyncio.wrap_future(running), PATIENCE)
