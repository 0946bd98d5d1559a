"""Tables of the link: its address, security and time-outs, and the network that is emulated."""

from typing import Any, ClassVar, Final, Literal, Self

from pydantic import Field, model_validator

from mmt.scene.table import PartTable, ServedTable, Service

_LONGEST_SILENCE_MS: Final = 250.0

PROFILES: Final[dict[str, dict[str, float]]] = {
    "lan": {"delay_ms": 0.3, "jitter_ms": 0.2},
    "wifi": {"delay_ms": 3.0, "jitter_ms": 2.0, "jitter_time_ms": 5.0},
    "wan": {"delay_ms": 40.0, "jitter_ms": 10.0, "jitter_time_ms": 50.0},
    "bad": {
        "delay_ms": 150.0,
        "jitter_ms": 60.0,
        "jitter_time_ms": 200.0,
        "loss": 0.02,
        "burst_messages": 10.0,
    },
    "outage": {"delay_ms": 3.0, "jitter_ms": 2.0, "jitter_time_ms": 5.0, "outage_s": 2.0},
}
"""Values that each profile sets; keys given beside ``profile`` take precedence."""


class Link(ServedTable):
    """``[link]``: the leader listens, the follower connects."""

    runs_in: ClassVar[tuple[Service, ...]] = ("leader", "follower")

    port: int = Field(8765, ge=0, le=65_535)
    frames_per_message: int = Field(1, ge=1, le=100)
    patience_s: float = Field(10.0, ge=0.5, le=3600)
    clock_hz: float = Field(20.0, ge=0, le=100)
    keep_s: float = Field(10.0, ge=0, le=60)
    silence_ms: float = Field(100.0, ge=10, le=10_000)
    longest_silence_ms: float | None = Field(None, ge=10, le=10_000)
    on_silence: Literal["hold", "retract"] = "hold"
    retract_mm: float = Field(10.0, gt=0, le=100)
    stale_ms: float = Field(500.0, ge=10, le=10_000)
    recovery_mm_s: float = Field(50.0, ge=1, le=1000)
    limit_mm_s: float = Field(1000.0, ge=10, le=10_000)

    @model_validator(mode="after")
    def _bounds(self) -> Self:
        if self.longest_wait_ms < self.silence_ms:
            raise ValueError(
                f"longest_silence_ms is {self.longest_wait_ms:g}, less than silence_ms, "
                f"{self.silence_ms:g}: give as much or more"
            )
        return self

    @property
    def longest_wait_ms(self) -> float:
        """``longest_silence_ms`` if given, else ``silence_ms`` if given, else 250."""
        if self.longest_silence_ms is not None:
            return self.longest_silence_ms
        return self.silence_ms if "silence_ms" in self.model_fields_set else _LONGEST_SILENCE_MS


class Network(PartTable):
    """``[network]``: emulated network; each service treats its messages before it sends them."""

    runs_in: ClassVar[tuple[Service, ...]] = ("leader", "follower")

    profile: Literal["lan", "wifi", "wan", "bad", "outage"] | None = None
    direction: Literal["both", "up", "down"] = "both"
    delay_ms: float = Field(0.0, ge=0, le=1000)
    jitter_ms: float = Field(0.0, ge=0, le=1000)
    jitter_time_ms: float = Field(0.0, ge=0, le=60_000)
    reorder: bool = False
    loss: float = Field(0.0, ge=0, le=1)
    burst_messages: float = Field(1.0, ge=1, le=100_000)
    burst_loss: float = Field(1.0, gt=0, le=1)
    retransmit: bool = False
    duplicate: float = Field(0.0, ge=0, le=1)
    bandwidth_kbit_s: float | None = Field(None, ge=1, le=100_000)
    queue_ms: float = Field(200.0, ge=1, le=1000)
    outage_s: float = Field(0.0, ge=0, le=3600)
    outage_every_s: float = Field(10.0, ge=0.01, le=86_400)
    seed: int | None = Field(None, ge=0, lt=2**63)

    @model_validator(mode="before")
    @classmethod
    def _of_profile(cls, given: Any) -> Any:
        """Fill in the profile's values; an unknown profile fails with the other keys."""
        profile = given.get("profile") if isinstance(given, dict) else None
        return {**PROFILES.get(profile, {}), **given} if isinstance(profile, str) else given

    @model_validator(mode="after")
    def _combinations(self) -> Self:
        if self.jitter_ms > self.delay_ms:
            raise ValueError(
                "jitter_ms must not exceed delay_ms: the delay lies within delay_ms +- jitter_ms"
            )
        if self.loss > self.burst_loss:
            raise ValueError("loss must not exceed burst_loss: no message is lost between bursts")
        if self.retransmit and (self.reorder or self.loss > 0.5):  # more is an outage
            raise ValueError(
                "retransmit keeps the order, and needs a loss of at most 0.5: leave out reorder, "
                "or lower loss"
            )
        if self.outage_s > self.outage_every_s:
            raise ValueError("outage_s must not exceed outage_every_s, from start to start")
        return self

    def describe(self) -> str:
        """Return a one-line summary of the emulation."""
        ways = "" if self.direction == "both" else f" {self.direction} alone"
        bandwidth = self.bandwidth_kbit_s
        effects = [
            (self.delay_ms > 0, f"delay {self.delay_ms:g} +- {self.jitter_ms:g} ms"),
            (self.reorder, "reordering"),
            (self.loss > 0, f"{self.loss:.3g} lost in bursts of {self.burst_messages:g}"),
            (self.retransmit, "lost ones sent again"),
            (self.duplicate > 0, f"{self.duplicate:.3g} repeated"),
            (bandwidth is not None, f"{bandwidth or 0:g} kbit/s"),
            (self.outage_s > 0, f"out {self.outage_s:g} s every {self.outage_every_s:g} s"),
        ]
        texts = [text for holds, text in effects if holds]
        return ", ".join(texts) + ways if texts else "none"
