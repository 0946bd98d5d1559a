"""The scene's table ``[force_feedback]``: how the remote force reaches the hand."""

from typing import Annotated, Final, Literal, Self

from pydantic import Field, model_validator

from mmt.scene.table import PartTable, Service

_PORT: Final = ("reserve_mj", "largest_damping_n_s_m")
_KEYS: Final[dict[str, tuple[str, ...]]] = {
    "streamed": (),
    "passive": (*_PORT, "largest_drift_mm"),
    "model": (*_PORT, "largest_stiffness_n_mm", "contact_n", "forgetting_s"),
}
"""Keys that only some methods have, by method."""


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
