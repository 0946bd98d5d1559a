"""Who listens to a shared model, as the process that serves them tells it."""

from collections import deque
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from prometheus_client.core import Metric

_MOST_LEFT: Final = 100
"""Listeners in the summary; the recording has all of them."""
_KINDS: Final = ("wholes", "changes", "states")


class Listeners:
    """The figures of those who listen, and of those who have left."""

    def __init__(self) -> None:
        self.figures: dict[str, Any] = {}
        """As `mmt_share.server.SharingServer.figures`, of the last second; empty before."""
        self.now = self.most = 0
        """How many listen, and the most that did at once."""
        self.sent: dict[str, float] = {}
        """What all of them together were sent, known at the end."""
        self._left: deque[dict[str, Any]] = deque(maxlen=_MOST_LEFT)

    def take_event(self, details: dict[str, Any]) -> None:
        """Take that one has come or gone."""
        self.now = details["listeners"]
        self.most = max(self.now, self.most)
        if details["kind"] == "listener left":
            self._left.append(details["listener"])

    def take_figures(self, figures: dict[str, Any], listened_s: float | None) -> None:
        """Take the figures of a second; with those of the end comes how long all have listened."""
        self.figures = figures
        if listened_s is not None:
            self.sent = {**figures["sent"], "listened_s": listened_s}

    def summary(self) -> dict[str, Any]:
        """Return what is known at the end; of the listeners the 100 that left last."""
        return {
            "most_listeners": self.most,
            "joined": self.figures.get("joined", 0),
            "sent": self.sent,
            "listeners": list(self._left),
        }

    def metrics(self) -> "Iterable[Metric]":
        """Return how many listen, what they were sent, and how far they are behind."""
        from mmt.core.exposition import counter, gauge, labelled

        figures = self.figures
        yield gauge("listeners", "Listeners that are connected.", self.now)
        yield counter("listeners_joined", "Listeners that have joined.", figures.get("joined", 0))
        sent: dict[str, int] = figures.get("sent", {})
        for name, text, ending in (
            ("shared_messages", "Messages to all listeners, by kind.", ""),
            ("shared_bytes", "Bytes of messages to all listeners, by kind.", "_bytes"),
        ):
            values = {kind: sent.get(f"{kind}{ending}", 0) for kind in _KINDS}
            yield labelled(name, text, "kind", values)
        skipped = sent.get("skipped", 0)
        yield counter("shared_skipped_messages", "Messages that listeners skipped.", skipped)
        lags = {
            which: 1e-3 * lag_ms
            for which in ("median", "most")
            if (lag_ms := figures.get(f"lag_{which}_ms")) is not None
        }
        text = "From a state of the leader to the listeners that say so, now."
        yield labelled("listener_lag_seconds", text, "of", lags, grows=False)
