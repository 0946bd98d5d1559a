"""What the tables of a scene have in common."""

from typing import ClassVar, Literal

from pydantic import BaseModel, ConfigDict

Service = Literal["leader", "follower"]


class Table(BaseModel):
    """A table of a scene: unknown keys are errors, and its values do not change."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class OptionalTable:
    """Base of the tables of a scene: the settings of a part that may be left out."""

    runs_in: ClassVar[tuple[Service, ...]] = ("leader",)
    """The services in which the part runs, unless `services` depends on the table's values."""

    @property
    def services(self) -> tuple[Service, ...]:
        """The services in which the part runs with these values."""
        return self.runs_in


class PartTable(OptionalTable, Table):
    """The table of a part."""

    gives: ClassVar[tuple[Literal["model", "force"], ...]] = ()
    """What the part brings from another machine, which needs no follower here then."""
