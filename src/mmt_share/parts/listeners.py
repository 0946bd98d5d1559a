"""Figures of the listeners, as reported by the process that serves them."""

from collections import deque
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from prometheus_client.core import Metric

_MOST_LEFT: Final = 100
"""Past listeners in the summary; the recording has more."""
_KINDS: Final = ("wholes", "changes", "states")


class Listeners:
    """The figures of present and past listeners."""

    def __init__(self) -> None:
        self.figures: dict[str, Any] = {}
        """Newest result of `mmt_share.server.SharingServer.figures`; empty before the first."""
        self.now = self.most = 0
        """Number of listeners now, and the most at once."""
        self.sent: dict[str, float] = {}
        """Totals sent to all listeners; empty until the end."""
        self._left: deque[dict[str, Any]] = deque(maxlen=_MOST_LEFT)

    def record_event(self, details: dict[str, Any]) -> None:
        """Note that a listener has joined or left."""
        self.now = details["listeners"]
        self.most = max(self.now, self.most)
        if details["kind"] == "listener left":
            self._left.append(details["listener"])

    def take_figures(self, figures: dict[str, Any], listened_s: float | None) -> None:
        """Take new figures; the last ones come with the total time of listening in s."""
        self.figures = figures
        if listened_s is not None:
            self.sent = {**figures["sent"], "listened_s": listened_s}

    def summary(self) -> dict[str, Any]:
        """Return the final figures, with the 100 listeners that left last."""
        return {
            "most_listeners": self.most,
            "joined": self.figures.get("joined", 0),
            "sent": self.sent,
            "listeners": list(self._left),
        }

    def metrics(self) -> "Iterable[Metric]":
        """Yield metrics of the number of listeners, of the messages sent, and of the lag."""
        from mmt.core.output.exposition import counter, gauge, labelled

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
