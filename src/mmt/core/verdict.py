"""Verdict on a run, computed by one function: whether the run works, and whether it is good.

It states what happens now, how ready the model is, how the model's error compares with the just
noticeable difference, and the faults. Terminal, pages and reports show it unchanged.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal

from mmt.core.errors import FAILED

State = Literal["waiting", "running", "degraded", "failed"]
"""Grey, green, amber and red wherever a verdict is shown."""

_FAILURES: Final = (
    FAILED,
    f"follower {FAILED}",
    f"leader {FAILED}",
    "follower lost",
    "leader lost",
)
"""Prefixes of the outcomes of failed runs."""

_PLAYED: Final = {
    "synthesized": "from a saved model",
    "fading": "between the stream and the model",
    "streamed": "streamed",
    "silent": "no vibration",
}

LATE_SHARE: Final = 0.05
"""Share of ticks over 1 ms late that counts as a fault."""

_AT_ITS_END: Final = ("completed", "source ended")
"""Outcomes of a run that was not ended early."""


@dataclass(frozen=True)
class Facts:
    """Facts about a run, at a moment or at its end."""

    time_s: float | None = None
    """Session time (s)."""
    mode: str | None = None
    """Vibration that is played: "streamed", "fading", "synthesized", "silent", or None."""
    start_s: float | None = None
    """Session time since which the vibration comes from the model (s); None before."""
    forced: bool = False
    """Whether a person has fixed the mode by hand."""
    stop_s: float | None = None
    """Session time at which the model was complete (s); None before."""
    waits: str = ""
    """What the run waits for, as a sentence; "" if it does not wait."""
    outcome: str | None = None
    """How the run has ended, as in its summary; None while it runs."""
    models: bool = False
    """Whether a model is built."""
    readiness: float | None = None
    """Share of the strokes that should feel right, 0 to 1; None if it is not known."""
    takes_over_at: float | None = None
    """Readiness at which the model takes over the vibration; None if it never does."""
    fell: str = ""
    """Why the readiness has just fallen; "" if it has not."""
    played_share: float | None = None
    """Share of the model's power that the actuator plays, 0 to 1; None if it is not known."""
    completion: str = ""
    """Result of another criterion, in words, for a model without a readiness."""
    error_db: float | None = None
    """Error of the level (dB); None if it was not measured."""
    skin_error_db: float | None = None
    """Error of the level at the skin, behind the actuator (dB); None if it is not known."""
    jnd_db: float | None = None
    """Just noticeable difference of the level (dB)."""
    faults: Sequence[str] = ()
    """Faults of link, ticks, devices and signals, a sentence each."""


@dataclass(frozen=True)
class Verdict:
    """State of a run, with a few words for each fact, "" if a fact is not known."""

    state: State
    time: str
    now: str
    readiness: str
    error: str
    noticeable: str
    """How the error compares with the just noticeable difference."""
    faults: tuple[str, ...]
    """Faults, a sentence each."""

    @property
    def health(self) -> str:
        """The faults in one line, "all well" for none."""
        return "; ".join(self.faults) or "all well"

    @property
    def parts(self) -> tuple[str, ...]:
        """Parts of a one-line text, in order: time, now, error, readiness; empty ones left out."""
        error = self.error and f"error {self.error}"
        return tuple(filter(None, (self.time, self.now, error, self.readiness)))

    @property
    def sentence(self) -> str:
        """What happens now, and the faults, for a title."""
        return "; ".join([self.now, *(each for each in self.faults if each not in self.now)])

    def as_dict(self) -> dict[str, Any]:
        """Return the verdict for a page or a program."""
        more = {"health": self.health, "faults": list(self.faults), "sentence": self.sentence}
        return asdict(self) | more


def verdict(facts: Facts) -> Verdict:
    """Return the verdict on a run."""
    faults = _faults(facts)
    return Verdict(
        state=_state(facts, faults),
        time="" if facts.time_s is None else f"{facts.time_s:.1f} s",
        now=_now(facts),
        readiness=_readiness(facts),
        error=_error(facts),
        noticeable=_noticeable(facts),
        faults=tuple(faults),
    )


def has_failed(outcome: str | None) -> bool:
    """Return whether a run that has ended with this outcome has failed."""
    return outcome is not None and outcome.startswith(_FAILURES)


def _state(facts: Facts, faults: list[str]) -> State:
    if has_failed(facts.outcome):
        return "failed"
    if faults:
        return "degraded"
    return "waiting" if facts.waits and facts.outcome is None else "running"


def _faults(facts: Facts) -> list[str]:
    found = list(facts.faults)
    if facts.outcome is not None and has_failed(facts.outcome):
        return [facts.outcome, *(fault for fault in found if fault != facts.outcome)]
    if facts.outcome is not None and facts.models and facts.start_s is None:
        found.append("the model was never ready")
    return found


def _now(facts: Facts) -> str:
    outcome = facts.outcome
    if outcome is None:
        return facts.waits or _played(facts) or "running"
    if has_failed(outcome):
        return outcome
    played = _played(facts)
    if not played or outcome in _AT_ITS_END:
        return played or outcome
    return f"{played}; {outcome}"


def _played(facts: Facts) -> str:
    """Return the source of the vibration, "" if there is none and no model."""
    if facts.start_s is not None and facts.mode in ("synthesized", None):
        source = "model ready" if facts.mode is None else "from the model"
        complete = "" if facts.stop_s is None else f", complete at {facts.stop_s:.1f} s"
        text = f"{source} since {facts.start_s:.1f} s{complete}"
    elif facts.mode is None:
        return ""
    else:
        text = _PLAYED.get(facts.mode, facts.mode)
    return text + ", held by hand" * facts.forced


def _readiness(facts: Facts) -> str:
    if facts.readiness is None:
        return facts.completion
    text = f"{100.0 * facts.readiness:.0f} % should feel right"
    if facts.outcome is not None:
        return text
    if facts.played_share is not None:
        text += f", the actuator plays {100.0 * facts.played_share:.0f} % of the power"
    if facts.takes_over_at is not None and facts.start_s is None:
        text += f", {100.0 * facts.takes_over_at:.0f} % needed"
    return f"{text}, less than before: {facts.fell}" if facts.fell else text


def _error(facts: Facts) -> str:
    if facts.error_db is None:
        return ""
    skin_db = facts.skin_error_db
    return f"{facts.error_db:.1f} dB" + ("" if skin_db is None else f", {skin_db:.1f} at the skin")


def _noticeable(facts: Facts) -> str:
    if facts.error_db is None or facts.jnd_db is None:
        return ""
    relation = "less" if facts.error_db < facts.jnd_db else "more"
    return f"{relation} than the {facts.jnd_db:.1f} dB that are just noticeable"
