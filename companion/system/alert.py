"""Posts alerts to a URL of the owner's, such as ntfy's, from a thread of its own. Nothing waits for it.

The body is plain text, which ntfy and simple webhooks take as it is; ntfy also reads the headers Title and
Click, which others leave alone. Redirects are not followed, and no body is read.
"""

from __future__ import annotations

import http.client
import logging
import queue
import re
import ssl
import threading
import time
from collections import deque
from collections.abc import Sequence
from typing import Any, NamedTuple
from urllib.parse import SplitResult, urlsplit

log = logging.getLogger(__name__)

WAITING = 8
"""Alerts that may wait; further ones are dropped."""
PATIENCE = 10.0
"""Seconds for each of: connecting, TLS, and sending with the answer's first line."""
AGAIN = (2.0, 8.0, 30.0)
"""Seconds until an alert that failed is tried again."""
OLDEST = 120.0
"""Seconds after which an alert is dropped: it would tell of what is over."""
MOST, WITHIN = 6, 300.0
"""At most so many alerts are taken within so many seconds."""
_LONGEST = 512
_FIRST_LINE = 1024
_STATUS = re.compile(rb"HTTP/1\.[01] ([1-5][0-9]{2})(?: |\r?\n|$)")
_TRY_AGAIN = frozenset({408, 425, 429})


class Alert(NamedTuple):
    """What is posted. text: the body. link: what a click opens, "" for none."""

    title: str
    text: str
    link: str = ""


def read_alert_url(url: str) -> SplitResult | None:
    """Check where alerts are posted, "" for nowhere. Raises ValueError, which does not repeat it."""
    if not url:
        return None
    if len(url) > _LONGEST or not re.fullmatch(r"[!-~]+", url):
        raise ValueError(f"an address of at most {_LONGEST} letters without spaces: https://ntfy.sh/TOPIC")
    try:
        split = urlsplit(url)
        fits = split.scheme in ("http", "https") and bool(split.hostname) and split.port != 0
    except ValueError:
        fits = False
    if not fits:
        raise ValueError("write it as https://HOST/PATH")
    if split.username is not None:
        raise ValueError("leave user and password out: ntfy takes its token as ?auth=...")
    return split


class AlertSender:
    """Takes alerts and posts them, one after the other; a full queue drops them.

    Any thread may call `send` and `figures`, which never wait. The URL is never logged or told: it may hold a
    token. Raises ValueError for a URL that is none.
    """

    def __init__(
        self, url: str, shown: str, again: Sequence[float] = AGAIN, patience: float = PATIENCE
    ) -> None:
        """shown: what may be shown of the URL. again, patience: see `AGAIN` and `PATIENCE`."""
        self._url = read_alert_url(url)
        self._shown, self._again, self._patience = shown, again, patience
        self._queue: queue.Queue[tuple[float, Alert]] = queue.Queue(WAITING)
        self._taken: deque[float] = deque(maxlen=MOST)
        self._over = threading.Event()
        self._counts = {"sent": 0, "failed": 0, "dropped": 0}
        self._trouble = ""
        if self._url is not None:
            threading.Thread(target=self._run, name="alert", daemon=True).start()

    @property
    def on(self) -> bool:
        """Whether there is a URL."""
        return self._url is not None

    def send(self, alert: Alert) -> None:
        """Queue an alert. Too many of them are dropped, and counted."""
        if self._url is None:
            return
        now = time.monotonic()
        try:
            if len(self._taken) == MOST and now - self._taken[0] < WITHIN:
                raise queue.Full
            self._queue.put_nowait((now, alert))
            self._taken.append(now)
        except queue.Full:
            self._counts["dropped"] += 1

    def figures(self) -> dict[str, Any]:
        """Return where they go, how many were sent, failed, were dropped and wait, and what is wrong."""
        waiting = self._queue.qsize()
        return {
            "to": self._shown if self.on else "",
            **self._counts,
            "waiting": waiting,
            "trouble": self._trouble,
        }

    def close(self) -> None:
        """End without waiting: what was not posted is lost."""
        self._over.set()

    def _run(self) -> None:
        while not self._over.is_set():
            try:
                since, alert = self._queue.get(timeout=1.0)
            except queue.Empty:
                continue
            try:
                self._deliver(since, alert)
            except Exception as error:
                self._failed(f"{type(error).__name__}")

    def _deliver(self, since: float, alert: Alert) -> None:
        for pause in (*self._again, None):
            if time.monotonic() - since > OLDEST:
                self._counts["dropped"] += 1
                return
            try:
                status = self._post(alert)
                trouble = "" if 200 <= status < 300 else f"answered {status}"
                final = not (status >= 500 or status in _TRY_AGAIN)
            except (OSError, ValueError, http.client.HTTPException) as error:
                trouble, final = f"no answer ({type(error).__name__})", False
            if not trouble:
                self._counts["sent"] += 1
                self._trouble = ""
                return
            self._trouble = trouble
            if final or pause is None or self._over.wait(pause):
                break
        self._failed(trouble)

    def _failed(self, trouble: str) -> None:
        self._counts["failed"] += 1
        self._trouble = trouble
        log.warning("an alert to %s was not taken: %s", self._shown, trouble)

    def _post(self, alert: Alert) -> int:
        """Post it once. Returns the answer's status. Raises OSError, ValueError or HTTPException."""
        url = self._url
        assert url is not None
        host = url.hostname or ""
        # Named always: without a port HTTPConnection takes the end of an IPv6 address for one.
        port = url.port or (443 if url.scheme == "https" else 80)
        connection = (
            http.client.HTTPSConnection(
                host, port, timeout=self._patience, context=ssl.create_default_context()
            )
            if url.scheme == "https"
            else http.client.HTTPConnection(host, port, timeout=self._patience)
        )
        headers = {"Content-Type": "text/plain; charset=utf-8", "Title": _header(alert.title)}
        if alert.link:
            headers["Click"] = _header(alert.link)
        path = (url.path or "/") + (f"?{url.query}" if url.query else "")
        try:
            connection.request("POST", path, alert.text.encode(), headers | {"Connection": "close"})
            return self._status(connection.sock)
        finally:
            connection.close()

    def _status(self, sock: Any) -> int:
        """Read the answer's first line and no more. A server that answers byte by byte gets no longer."""
        deadline, head = time.monotonic() + self._patience, b""
        while b"\n" not in head and len(head) < _FIRST_LINE:
            left = deadline - time.monotonic()
            if left <= 0:
                raise TimeoutError("it answers too slowly")
            sock.settimeout(left)
            part = sock.recv(_FIRST_LINE - len(head))
            if not part:
                break
            head += part
        found = _STATUS.match(head)
        if found is None:
            raise ValueError("no HTTP")
        return int(found[1])


def _header(text: str) -> str:
    """Make a text that a header can carry: printable ASCII on one line."""
    return re.sub(r"[^ -~]", "?", text)[:200]
