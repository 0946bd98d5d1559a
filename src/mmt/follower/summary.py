"""What the follower says of itself at the end."""

from dataclasses import asdict, dataclass, field
from typing import Any, Final

from mmt.core.errors import FAILED

_UNWANTED: Final = (FAILED, f"leader {FAILED}", "leader lost")


@dataclass(frozen=True)
class FollowerSummary:
    """What the follower did.

    ``outcome`` is "source ended", "leader stopped (...)", "stopped" (by the person),
    "leader lost", "leader failed: ..." or "failed: ...", each with what failed.
    """

    outcome: str
    session: dict[str, Any]
    link: dict[str, Any]
    ticks: dict[str, Any]
    process: dict[str, Any]
    commands: dict[str, Any] = field(default_factory=dict)
    backfill: dict[str, Any] = field(default_factory=dict)
    devices: dict[str, Any] = field(default_factory=dict)
    feedback: dict[str, Any] = field(default_factory=dict)

    @property
    def problem(self) -> str | None:
        """What made the run end in a way that nobody wanted, None where nothing did."""
        return self.outcome if self.outcome.startswith(_UNWANTED) else None

    def as_dict(self) -> dict[str, Any]:
        """Return the summary for a program."""
        return asdict(self)
