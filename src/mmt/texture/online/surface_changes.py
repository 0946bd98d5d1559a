"""Changes of surface that are detected or stated by a person."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple


@dataclass(frozen=True)
class SurfaceChange:
    """A change of the surface under the tool.

    ``kind``: a ``"new"`` surface; one met before, ``"recalled"`` by a person; or the new one,
    ``"identified"`` by a person as one met before. ``before`` and ``surface`` are the numbers of
    the two surfaces. ``from_sample``: the first sample that is no longer the former one's;
    ``at_sample``: the sample at which it was detected or said. ``evidence``: natural logarithm
    of the Bayes factor, None if a person said it.
    """

    kind: Literal["new", "recalled", "identified"]
    before: int
    surface: int
    from_sample: int
    at_sample: int
    evidence: float | None = None


class SurfaceStatement(NamedTuple):
    """Statement of a person: from this sample (sequence number) on, the tool is on a surface."""

    sample: int
    surface: int


def surface_statements(events: Iterable[Mapping[str, Any]]) -> list[SurfaceStatement]:
    """Return the statements of persons from a recording's events of surface changes."""
    stated = [
        (event.get("at_sample"), event.get("surface"))
        for event in events
        if "evidence" in event and event["evidence"] is None
    ]
    return [
        SurfaceStatement(sample, surface)
        for sample, surface in stated
        if isinstance(sample, int) and isinstance(surface, int) and sample >= 0 < surface
    ]
