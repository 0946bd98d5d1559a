"""Tables of what the leader does: render, play, display force, record, and show the run."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal, Self

from pydantic import Field, model_validator

from mmt.scene.table import PartTable, Service

_PORT: Final = ("reserve_mj", "largest_damping_n_s_m")
_KEYS: Final[dict[str, tuple[str, ...]]] = {
    "streamed": (),
    "passive": (*_PORT, "largest_drift_mm"),
    "model": (*_PORT, "largest_stiffness_n_mm", "contact_n", "forgetting_s"),
}
"""Keys that only some methods have, by method."""


class Rendering(PartTable):
    """``[rendering]``: synthesize vibration from the model."""

    model: Path | None = None
    before: Literal["stream", "silent"] = "stream"
    generator: str | None = Field(None, min_length=1)
    renewal_samples: int = Field(1, ge=1, le=1000)
    crossfade_ms: float = Field(50.0, ge=0, le=1000)

    @model_validator(mode="before")
    @classmethod
    def _without_former(cls, table: Any) -> Any:
        if isinstance(table, Mapping):
            for key in _FORMER.keys() & table.keys():
                raise ValueError(f"{key}: no longer a key; {_FORMER[key]}")
            if table.get("before") == "warm":
                raise ValueError(f'before = "warm": no longer a choice; {_FORMER["library"]}')
        return table


_FORMER: Final = {
    "library": "known textures served no better than a local model as early: leave it out, and to "
    "render earlier write start_share = 0.5 in [texture]",
    "update_fade_ms": "each state of the model is rendered at once: leave it out",
}
"""Keys of earlier versions, with what to write instead."""


def without_former(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table without keys and values that only earlier versions had."""
    kept = {key: value for key, value in table.items() if key not in _FORMER}
    if kept.get("before") == "warm":
        del kept["before"]
    return kept


class Playout(PartTable):
    """``[playout]``: play streamed vibration through a jitter buffer."""

    delay_ms: Annotated[float, Field(ge=0, le=1000)] | Literal["auto"] = "auto"
    longest_delay_ms: float = Field(100.0, gt=0, le=1000)
    conceal: Literal["auto", "model", "repetition", "silence"] = "auto"


class ForceFeedback(PartTable):
    """``[force_feedback]``: the remote force goes to the leader's interface."""

    method: Literal["streamed", "passive", "model"] = "streamed"
    limit_n: float = Field(3.3, gt=0, le=40)
    slew_n_s: Annotated[float, Field(gt=0, le=1e6)] | Literal["off"] = 1000.0
    reserve_mj: float = Field(1.0, ge=0.01, le=100)
    largest_damping_n_s_m: float = Field(10.0, ge=0, le=100)
    largest_drift_mm: float = Field(3.0, ge=0, le=50)
    largest_stiffness_n_mm: float = Field(10.0, ge=0.1, le=100)
    contact_n: float = Field(0.2, ge=0.02, le=5)
    forgetting_s: float = Field(0.5, ge=0.05, le=60)

    @model_validator(mode="after")
    def _keys_of_the_method(self) -> Self:
        allowed = {"method", "limit_n", "slew_n_s", *_KEYS[self.method]}
        for key in sorted(self.model_fields_set - allowed):
            default = type(self).model_fields[key].default
            if getattr(self, key) == default:
                continue  # a resolved scene holds every default
            methods = " or ".join(f'"{name}"' for name, keys in _KEYS.items() if key in keys)
            raise ValueError(
                f'{key} has no meaning with method = "{self.method}": '
                f"remove it, or set method = {methods}"
            )
        return self

    @property
    def services(self) -> tuple[Service, ...]:
        """The leader; with every method but ``streamed`` also the follower."""
        return self.runs_in if self.method == "streamed" else ("leader", "follower")


class Recording(PartTable):
    """``[recording]``: every frame received goes into an MCAP file."""

    file: Path = Path("mmt-demo/session.mcap")
    channels: Literal["all", "needed"] = "all"
    existing: Literal["number", "refuse", "replace"] = "number"
    scalars: bool = False


class Metrics(PartTable):
    """``[metrics]``: serve metrics for Prometheus at the leader's and the follower's ports."""

    runs_in: ClassVar[tuple[Service, ...]] = ("leader", "follower")

    follower_port: int | None = Field(None, ge=1, le=65_535)


class Monitor(PartTable):
    """``[monitor]``: the leader serves a live page of the run."""

    updates_hz: float = Field(25.0, ge=1, le=60)
