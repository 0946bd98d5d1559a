"""A service's counts as Prometheus metrics, computed only when they are scraped.

A run whose scene lacks ``[metrics]`` does not import this module. The metrics need no counting of
their own: the services keep these figures for their summaries.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, Final

from prometheus_client import CollectorRegistry, ProcessCollector
from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    Metric,
)

from mmt.core.extras import __version__
from mmt.core.running.ticking import Ticker, TimeHistogram

_AROUND_A_TICK_S: Final = (9e-4, 9.5e-4, 9.8e-4, 1e-3, 1.02e-3, 1.05e-3, 1.1e-3, 1.2e-3, 1.5e-3)
BOUNDS_S: Final = (
    *(1e-4, 2e-4, 5e-4, 8e-4, *_AROUND_A_TICK_S, 2e-3, 3e-3, 5e-3),
    *(0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0),
)
"""Upper bounds of a histogram's bins, 0.1 ms to 1 s; dense around the tick's period of 1 ms."""


class _Collector:
    def __init__(self, collect: Callable[[], Iterable[Metric]]) -> None:
        self._collect = collect

    def collect(self) -> Iterable[Metric]:
        return self._collect()


def registry_of(collect: Callable[[], Iterable[Metric]]) -> CollectorRegistry:
    """Return a registry of these metrics, and of the process's processor time and memory."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(_Collector(collect))
    ProcessCollector(registry=registry)
    return registry


def counter(name: str, text: str, value: float) -> Metric:
    """Return a metric that only grows."""
    return CounterMetricFamily(f"mmt_{name}", text, value=value)


def gauge(name: str, text: str, value: float) -> Metric:
    """Return a metric that goes up and down."""
    return GaugeMetricFamily(f"mmt_{name}", text, value=value)


def labelled(
    name: str, text: str, label: str, values: Mapping[str, float], *, grows: bool = True
) -> Metric:
    """Return a counter for each value of a label, or a gauge unless `grows`."""
    family: Any = (CounterMetricFamily if grows else GaugeMetricFamily)(
        f"mmt_{name}", text, labels=[label]
    )
    for key, value in values.items():
        family.add_metric([key], value)
    labelled_metric: Metric = family
    return labelled_metric


def state(name: str, text: str, label: str, now: str, all_of: Iterable[str]) -> Metric:
    """Return a gauge for each state: 1 for the current one, 0 for the others."""
    return labelled(name, text, label, {key: float(key == now) for key in all_of}, grows=False)


def histogram(name: str, text: str, times: TimeHistogram) -> Metric:
    """Return the counts of a time histogram, in seconds."""
    counts, sum_ns = times.cumulative([round(bound * 1e9) for bound in BOUNDS_S])
    buckets: list[Any] = [
        (repr(bound), count) for bound, count in zip(BOUNDS_S, counts, strict=True)
    ]
    total = max(times.count, counts[-1])
    return HistogramMetricFamily(
        f"mmt_{name}_seconds", text, buckets=[*buckets, ("+Inf", total)], sum_value=sum_ns / 1e9
    )


def session(session_id: str | None, service: str) -> Metric:
    """Return a metric whose labels name the session."""
    family = GaugeMetricFamily(
        "mmt_session_info", "The session, always 1.", labels=["id", "service", "version"]
    )
    family.add_metric([session_id or "", service, __version__], 1.0)
    return family


def link_metrics(link: Any, latency: TimeHistogram) -> Iterator[Metric]:
    """Yield the counts of one side of the link.

    Parameters
    ----------
    link
        `mmt.link.protocol.LinkStatistics`.
    latency
        One-way latencies of received frames or commands, counted while the clock offset is known.
    """
    for name, text in (
        ("frames", "Frames sent (follower) or accepted (leader)."),
        ("commands", "Commands accepted (follower) or sent (leader)."),
        ("messages_sent", "Messages sent."),
        ("messages_received", "Messages received."),
        ("bytes_sent", "Bytes sent."),
        ("bytes_received", "Bytes received."),
        ("lost", "Frames or commands that never came."),
        ("out_of_order", "Frames or commands that came after a newer one."),
        ("repeated", "Frames or commands that came twice."),
        ("dropped", "Frames or commands given up before they were sent."),
    ):
        yield counter(name, text, getattr(link, name))
    yield labelled("rejected", "What could not be used, by reason.", "reason", link.rejected)
    yield histogram("latency", "One way, from measuring or commanding to arrival.", latency)
    if link.emulated:
        lost, repeated = link.emulated["lost"], link.emulated["repeated"]
        once = link.emulated["messages"] - lost - repeated
        fates = {"once": once, "lost": lost, "repeated": repeated}
        yield labelled("emulated", "Messages by what an emulated network did.", "fate", fates)
    yield from _clock_metrics(link.clock)


def _clock_metrics(clock: Mapping[str, float | None]) -> Iterator[Metric]:
    yield counter("clock_jumps", "Steps of one clock against the other.", clock["jumps"] or 0)
    for name, text in (
        ("offset", "The other side's clock minus this one's."),
        ("uncertainty", "The offset is right to this."),
    ):
        value_ms = clock[f"{name}_ms"]
        if value_ms is not None:
            yield gauge(f"clock_{name}_seconds", text, value_ms / 1e3)


def tick_metrics(ticker: Ticker) -> Iterator[Metric]:
    """Yield how punctual a service's ticks are."""
    ticks, late = ticker.lateness
    missed = ticker.statistics.missed
    yield counter("ticks", "Ticks that fell due.", ticks)
    yield counter("ticks_missed", "Ticks handed over together with a later one.", missed)
    yield counter("ticks_late", "Ticks that were over 1 ms late.", late)
    yield histogram("tick_period", "Time from tick to tick.", ticker.periods)
