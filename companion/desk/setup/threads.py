"""Carries out calls of a page in threads that keep nothing from ending."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from companion.pages.requests import RequestError


class DaemonThreads:
    """Runs each call in a daemon thread: the program can end while one hangs, unlike with asyncio's."""

    def __init__(self, most: int) -> None:
        """most: calls at once."""
        self._free = threading.BoundedSemaphore(most)

    async def call(self, act: Callable[[], Any], within: float) -> Any:
        """Return what `act` returns, or raise what it raises.

        within: s until TimeoutError is raised; the call goes on. Raises RequestError while too many run.
        """
        if not self._free.acquire(blocking=False):
            raise RequestError("what was asked before still runs: wait a moment")
        loop = asyncio.get_running_loop()
        future: asyncio.Future[Any] = loop.create_future()

        def settle(result: Any, error: Exception | None) -> None:
            if future.done():  # nobody waits any more
                return
            if error is None:
                future.set_result(result)
            else:
                future.set_exception(error)

        def run() -> None:
            result, failed = None, None
            try:
                result = act()
            except Exception as error:  # it is raised where it is awaited
                failed = error
            finally:
                self._free.release()
            with suppress(RuntimeError):  # the server has ended
                loop.call_soon_threadsafe(settle, result, failed)

        threading.Thread(target=run, name="call", daemon=True).start()
        return await asyncio.wait_for(future, within)
