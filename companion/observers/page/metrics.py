"""Makes Prometheus metrics of the newest news."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from prometheus_client import generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector, CollectorRegistry

from companion.observers.page.news import FRESH, WELL, News
from companion.pages.access import WrongTokens
from companion.wire.ids import Policy

_PREFIX = "anytraverse_"
_STATES = (*sorted(WELL), "fault", "starting")
_POLICIES = tuple(policy.name.lower() for policy in Policy)
_VERDICTS = ("pass", "skip", "warn", "fail")


class _Figure(NamedTuple):
    """One metric. name: "_total" at its end makes a counter. path: where it is in the status document.

    factor: to the unit of its name.
    """

    name: str
    path: str
    meaning: str
    factor: float = 1.0


_MIB = 1 << 20
# fmt: off
FIGURES = (
    _Figure("open_call_id", "current_id", "Id of the open call or hold, 0 without one."),
    _Figure("frames_judged_total", "frames", "Judged frames since the start."),
    _Figure("camera_frames_read_total", "camera.read", "Frames read since vision started."),
    _Figure("camera_frames_dropped_total", "camera.dropped", "Frames dropped since vision started."),
    _Figure("camera_rate_hertz", "camera.rate", "Frames that the camera delivers a second."),
    _Figure("judging_rate_hertz", "judging.rate", "Frames that are to be judged a second."),
    _Figure("judging_seconds", "perceiver.step_ms", "Time of judging the newest frame.", 1e-3),
    _Figure("latency_seconds", "latency_ms", "From capture until judged, median of 25.", 1e-3),
    _Figure("roi_uncertainty_ratio", "roi_uncertainty", "Mean uncertainty of the region of interest."),
    _Figure("scene_similarity_ratio", "similarity", "Cosine to the reference scene."),
    _Figure("vision_restarts_total", "vision.restarts", "Restarts of the vision process."),
    _Figure("page_restarts_total", "web.restarts", "Restarts of this page."),
    _Figure("recording", "recording.on", "1 while it is recorded."),
    _Figure("recordings_bytes", "recording.bytes", "Size of all recordings."),
    _Figure("recordings", "recording.files", "Recordings on the disk."),
    _Figure("recording_messages_written_total", "recording.written", "Messages that were recorded."),
    _Figure("recording_messages_lost_total", "recording.lost", "Messages that were not recorded."),
    _Figure("recording_frames_left_out_total", "recording.left_out", "Frames left out of the recordings."),
    _Figure("recorder_restarts_total", "recording.restarts", "Restarts of the recorder."),
    _Figure("live_view_clients", "live.clients", "Viewers of the live view."),
    _Figure("live_view_messages_lost_total", "live.lost", "Messages that the live view was not sent."),
    _Figure("live_view_restarts_total", "live.restarts", "Restarts of the live view."),
    _Figure("link_frames_lost_total", "link.lost", "MAVLink frames that waited too long."),
    _Figure("link_frames_bad_total", "link.bad", "Broken MAVLink frames received."),
    _Figure("link_texts_unsaid_total", "link.unsaid", "Texts not sent."),
    _Figure("link_summaries_dropped_total", "link.dropped_summaries", "Summaries not sent."),
    _Figure("disk_failing", "disk.failing", "1 while the journal cannot be written."),
    _Figure("temperature_celsius", "computer.temperature", "The hottest sensor."),
    _Figure("throttled", "computer.throttled", "1 while the CPU is slowed down."),
    _Figure("under_voltage", "computer.under_voltage", "1 while the supply's voltage is too low."),
    _Figure("cpu_used_ratio", "computer.cpu", "Share of all cores' time in use."),
    _Figure("memory_bytes", "computer.memory", "Memory.", _MIB),
    _Figure("memory_free_bytes", "computer.memory_free", "Memory that is free.", _MIB),
    _Figure("disk_bytes", "computer.disk", "Room of the state folder's disk.", _MIB),
    _Figure("disk_free_bytes", "computer.disk_free", "Free room of that disk.", _MIB),
)
# fmt: on


class Metrics(Collector):  # type: ignore[misc]  # it is Any for mypy
    """Collects the figures of the news when it is asked. Outdated ones are left out, but for `up`."""

    def __init__(self, news: News, wrong_tokens: WrongTokens) -> None:
        self._news = news
        self._wrong_tokens = wrong_tokens
        self._registry = CollectorRegistry(auto_describe=False)
        self._registry.register(self)

    def text(self) -> bytes:
        """Return the metrics in Prometheus' text format."""
        text: bytes = generate_latest(self._registry)
        return text

    def describe(self) -> Iterator[Metric]:
        """Describe nothing, so that nothing is collected at registration."""
        yield from ()

    def collect(self) -> Iterator[Metric]:
        """Make the metrics."""
        news, fresh = self._news, self._news.age <= FRESH
        yield _gauge("up", "1 while the companion tells what it does.", float(fresh))
        count = self._wrong_tokens.count
        yield CounterMetricFamily(f"{_PREFIX}wrong_tokens_total", "Requests with a wrong token.", value=count)
        yield _gauge("well", "1 while it is known to do its work, as /healthz.", float(not news.trouble()))
        if math.isfinite(news.age):
            yield _gauge("news_age_seconds", "Since the companion told something.", news.age)
        if not fresh:
            return
        status, check = _table(news.told, "status"), _table(news.told, "check")
        yield _one_of("state", "The companion's state.", _STATES, news.state)
        yield _one_of("policy", "The policy in force.", _POLICIES, status.get("policy"))
        for figure in FIGURES:
            value = _number(status, figure.path)
            if value is not None:
                kind = CounterMetricFamily if figure.name.endswith("_total") else GaugeMetricFamily
                yield kind(f"{_PREFIX}{figure.name}", figure.meaning, value=value * figure.factor)
        yield from _checks(check.get("checks"))


def _gauge(name: str, meaning: str, value: float) -> Metric:
    return GaugeMetricFamily(f"{_PREFIX}{name}", meaning, value=value)


def _one_of(name: str, meaning: str, values: tuple[str, ...], present: object) -> Metric:
    """Make a gauge with one series a value: 1 for the present one."""
    metric = GaugeMetricFamily(f"{_PREFIX}{name}", meaning, labels=[name])
    for value in values:
        metric.add_metric([value], float(value == present))
    return metric


def _checks(rows: object) -> Iterator[Metric]:
    if not isinstance(rows, list):
        return
    found = [row.get("verdict") for row in rows if isinstance(row, dict)]
    metric = GaugeMetricFamily(f"{_PREFIX}checks", "Checks by verdict.", labels=["verdict"])
    for verdict in _VERDICTS:
        metric.add_metric([verdict], found.count(verdict))
    yield metric


def _table(of: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    found = of.get(name)
    return found if isinstance(found, dict) else {}


def _number(status: Mapping[str, Any], path: str) -> float | None:
    found: Any = status
    for name in path.split("."):
        found = found.get(name) if isinstance(found, dict) else None
    return float(found) if isinstance(found, (bool, int, float)) and math.isfinite(found) else None
