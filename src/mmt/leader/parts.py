"""The list of the leader's parts; a part that a scene leaves out is not imported.

Parts are built, and their verbs called, in the order of the list: parts that read come before
parts that play. To add a part, write its module, a builder and a line; another package adds
one by an entry point (`mmt.scene.table`).
"""

from collections.abc import Callable, Collection
from functools import partial
from typing import TYPE_CHECKING, Final, NamedTuple

from mmt.leader import building
from mmt.leader.building import LeaderParts
from mmt.leader.part import Part, Session
from mmt.scene import Scene
from mmt.scene.table import added_parts, imported

if TYPE_CHECKING:
    from mmt.leader.modelling.process import ModellingProcess


class PartEntry(NamedTuple):
    """How a part is made, and whether a scene has it."""

    build: Callable[[Session, LeaderParts], Part | None]
    """Returns the part, or None if it is not needed, given the session and the earlier parts."""
    wanted: Callable[[Scene], bool]
    tasks: tuple[str, ...] = ()
    """Names of the tasks that it runs beside the ticks."""
    numerics: tuple[str, ...] = ()
    """Modules with compiled kernels that it imports when it is built."""


_OWN: Final[dict[str, PartEntry]] = {
    "recording": PartEntry(
        building.recording,
        lambda scene: scene.recording is not None or scene.monitor is not None,
    ),
    "hand": PartEntry(building.hand, lambda scene: scene.commands),
    "playout": PartEntry(
        building.playout,
        lambda scene: scene.streams,
        numerics=("mmt.texture.synthesis.concealment",),
    ),
    "motion": PartEntry(building.motion, lambda scene: scene.rendering is not None),
    "force_feedback": PartEntry(
        building.force_feedback,
        lambda scene: scene.force_feedback is not None,
    ),
    "modelling": PartEntry(
        building.modelling,
        lambda scene: scene.texture is not None,
        ("segmenting", "fitting", "synthesizing", "completing"),
        ("mmt.leader.modelling.pipeline",),
    ),
    "synthesizing": PartEntry(
        building.synthesizing,
        lambda scene: scene.rendering is not None,
        numerics=("mmt.texture.synthesis.synthesizer",),
    ),
    "vibration": PartEntry(building.vibration, lambda scene: scene.actuator is not None),
    "completing": PartEntry(building.completing, lambda _: True),
    "metrics": PartEntry(building.metrics, lambda scene: scene.metrics is not None),
    "monitor": PartEntry(building.monitor, lambda scene: scene.monitor is not None, ("monitor",)),
}
"""By name: how the part is made, and which scenes have it."""


def _with_added(own: dict[str, PartEntry]) -> dict[str, PartEntry]:
    """Return the parts with those that other packages add, each before the part that it names."""
    parts: dict[str, PartEntry] = {}

    def place(name: str, entry: PartEntry) -> None:
        for added, part in added_parts().items():
            if part.before == name:
                wanted = partial(_asks_for, key=part.key or added)
                place(added, PartEntry(partial(_added, part.home), wanted, part.tasks))
        parts[name] = entry

    for name, entry in own.items():
        place(name, entry)
    return parts


def _added(home: str, session: Session, parts: LeaderParts) -> Part | None:
    """Make another package's part, by `build(session, parts)` of its class."""
    part: Part | None = imported(home).build(session, parts)
    return part


def _asks_for(scene: Scene, key: str) -> bool:
    """Return whether a scene has the table, or the key of a table, ``table.key``."""
    table, _, field = key.partition(".")
    found = getattr(scene, table)
    return found is not None and (not field or getattr(found, field) is not None)


PARTS: Final = _with_added(_OWN)
"""The product's own parts and added ones."""


def tasks_of(scene: Scene) -> tuple[str, ...]:
    """Return the names of the tasks that a scene's leader runs beside the ticks."""
    entries = [entry for entry in PARTS.values() if entry.wanted(scene)]
    return tuple(name for entry in entries for name in entry.tasks)


def numerics_of(scene: Scene) -> list[str]:
    """Return the names of the modules with compiled kernels that a scene's leader imports."""
    if not scene.numerics:
        return []
    entries = [entry for entry in PARTS.values() if entry.wanted(scene)]
    names = [name for entry in entries for name in entry.numerics]
    table = scene.rendering
    if table is not None and (table.model is not None or scene.is_given("model")):
        # such a model is built in this process, a growing one in the one that models
        field = "mmt.texture.field"
        names += ["mmt.texture.model.rendered", f"{field}.posterior", f"{field}.shape_smoothing"]
    if table is not None and scene.actuator is not None and scene.actuator.driver is not None:
        # for the share of a model's power that the actuator plays
        names += ["mmt.texture.synthesis.actuator", "mmt.texture.autoregression.forms"]
    return names


def build_parts(
    session: Session,
    names: Collection[str] | None = None,
    *,
    modelling: "ModellingProcess | None" = None,
) -> LeaderParts:
    """Import, compile and assemble the parts that a session's scene needs.

    Nothing is opened: devices are connected by `Parts.connect`, files are made in `Part.begin`.
    For an experiment in simulated time, `build_parts(Session(scene), ["playout"])` gives the
    leader's own part by itself, as its ``playout``.

    Parameters
    ----------
    session
        Session of the run; it gets the parts.
    names
        Names of the parts to build; None for all that the scene needs.
    modelling
        The modelling process, if it was launched before.

    Raises
    ------
    InputError
        A file that the scene names cannot be used.
    MmtError
        A part cannot be made; the message says which and why.
    """
    session.parts = parts = LeaderParts()
    parts.modelling_process = modelling
    for name, entry in PARTS.items():
        if (names is None or name in names) and entry.wanted(session.scene):
            part = entry.build(session, parts)
            if part is not None:
                parts.add(part)
    return parts
