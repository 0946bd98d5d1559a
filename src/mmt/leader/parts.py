"""The list of the leader's parts; one that a scene leaves out is not even imported.

The order is that in which they are built and their verbs are called: what a tick reads comes
before what it plays. To add a part, write its module, a builder and a line; another package adds
one by an entry point (`mmt.scene.added`).
"""

from collections.abc import Callable, Collection
from functools import partial
from typing import Final, NamedTuple

from mmt.core.kernel_cache import LONGEST_COMPILATION_S
from mmt.leader import building
from mmt.leader.building import LeaderParts
from mmt.leader.part import Part, Session
from mmt.scene import Scene
from mmt.scene.added import added_parts, imported


class PartEntry(NamedTuple):
    """How a part is made, and whether a scene has it."""

    build: Callable[[Session, LeaderParts], Part | None]
    """Makes the part, with those before it; None for none."""
    wanted: Callable[[Scene], bool]
    tasks: tuple[str, ...] = ()
    """Names of the tasks that it runs beside the ticks."""
    numerics: tuple[str, ...] = ()
    """Modules with compiled kernels that it imports when it is built."""
    needs_model: bool = False
    """Whether no tick calls their kernels before there is a model."""


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
        ("mmt.leader.modelling.pipeline", "mmt.texture.field.observations"),
        needs_model=True,
    ),
    "synthesizing": PartEntry(
        building.synthesizing,
        lambda scene: scene.rendering is not None,
        numerics=("mmt.texture.synthesis.synthesizer", "mmt.texture.field.observations"),
        needs_model=True,
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
    """Whether a scene has the table, or the key of a table, ``table.key``."""
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
    return [name for entry in entries for name in entry.numerics]


def first_numerics_of(scene: Scene) -> list[str] | None:
    """Return the modules whose kernels are compiled before a session begins, None all.

    Those that its ticks call before there is a model. All where it takes a model, and where it
    could be over before the others are compiled beside it.
    """
    short = scene.session.duration_s <= LONGEST_COMPILATION_S
    if short or scene.texture is None or _takes_a_model(scene):
        return None
    entries = [entry for entry in PARTS.values() if entry.wanted(scene) and not entry.needs_model]
    return [name for entry in entries for name in entry.numerics]


def _takes_a_model(scene: Scene) -> bool:
    """Whether a model that was built elsewhere is rendered: saved or shared."""
    saved = scene.rendering is not None and scene.rendering.model is not None
    return saved or scene.is_given("model")


def build_parts(session: Session, names: Collection[str] | None = None) -> LeaderParts:
    """Import, compile and assemble the parts that a session's scene needs.

    Nothing is opened: devices are connected by `Parts.connect`, files are made in `Part.begin`.
    For an experiment in simulated time, `build_parts(Session(scene), ["playout"])` gives the
    leader's own part by itself, as its ``playout``.

    Parameters
    ----------
    session
        Session of the run; it gets the parts.
    names
        Which ones; None for all that the scene needs.

    Raises
    ------
    InputError
        A file that the scene names cannot be used.
    MmtError
        A part cannot be made; the message says which and why.
    """
    session.parts = parts = LeaderParts()
    for name, entry in PARTS.items():
        if (names is None or name in names) and entry.wanted(session.scene):
            part = entry.build(session, parts)
            if part is not None:
                parts.add(part)
    return parts
