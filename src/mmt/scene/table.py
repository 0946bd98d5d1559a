"""Base classes for the tables of a scene."""

from typing import ClassVar, Literal

from pydantic import BaseModel, ConfigDict

Service = Literal["leader", "follower"]


class Table(BaseModel):
    """Immutable table of a scene; unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class OptionalTable:
    """Base class for the settings of a part that a scene may leave out."""

    runs_in: ClassVar[tuple[Service, ...]] = ("leader",)
    """The services in which the part runs, unless `services` depends on the table's values."""

    @property
    def services(self) -> tuple[Service, ...]:
        """The services in which the part runs with these values."""
        return self.runs_in


class PartTable(OptionalTable, Table):
    """The table of a part, as a pydantic model."""

    gives: ClassVar[tuple[Literal["model", "force"], ...]] = ()
    """Data that the part receives from another machine, so that no follower has to send it."""
