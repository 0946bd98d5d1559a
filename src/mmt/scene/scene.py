"""The scene: settings of one run, a table for each part, and the checks across tables.

A part whose table is absent does not exist in that run. Both services read the same file.
Every key is documented in ``docs/reference/scene.md``.
"""

from typing import TYPE_CHECKING, Any, Final, Literal, Self, TypeVar, get_args

from pydantic import Field, create_model, model_validator

from mmt.core.frames import AccelerationRateHz, Channel, ordered_channels
from mmt.scene.device_tables import Actuator, Devices, Hand, Handle, MotionLimits, Replay, Simulated
from mmt.scene.leader_tables import (
    ForceFeedback,
    Metrics,
    Monitor,
    Playout,
    Recording,
    Rendering,
    Texture,
)
from mmt.scene.link_tables import Link, Network
from mmt.scene.table import (
    OptionalTable,
    PartTable,
    PassingTable,
    Service,
    Table,
    added_parts,
    added_tables,
    import_problem,
    imported,
)
from mmt.texture.settings import Axis

_Added = TypeVar("_Added", bound=PartTable)


class SessionTable(Table):
    """``[session]``: settings that every run has."""

    name: str = Field("session", min_length=1, max_length=64, pattern=r"^[\w.-]+$")
    duration_s: float = Field(18.0, gt=0, le=86_400)
    rate_hz: Literal[1000] = 1000
    acceleration_rate_hz: AccelerationRateHz = 1000
    orientation: bool | None = None
    seed: int = Field(1, ge=0, lt=2**63)

    @property
    def samples_per_frame(self) -> int:
        """Samples of acceleration per frame, and of vibration per tick."""
        return self.acceleration_rate_hz // self.rate_hz


class SceneTables(Table):
    """Tables of the built-in parts; the subclass `Scene` also has those of added parts."""

    session: SessionTable = SessionTable()
    link: Link | None = None
    network: Network | None = None
    simulated: Simulated | None = None
    replay: Replay | None = None
    devices: Devices | None = None
    hand: Hand | None = None
    handle: Handle | None = None
    texture: Texture | None = None
    rendering: Rendering | None = None
    playout: Playout | None = None
    actuator: Actuator | None = None
    force_feedback: ForceFeedback | None = None
    recording: Recording | None = None
    metrics: Metrics | None = None
    monitor: Monitor | None = None

    @model_validator(mode="before")
    @classmethod
    def _loadable(cls, tables: Any) -> Any:
        for name in tables if isinstance(tables, dict) else ():
            problem = import_problem(name)
            if problem is not None:
                raise ValueError(problem)
        return tables

    @model_validator(mode="after")
    def _combinations(self) -> Self:
        for problem in _impossible(self):
            raise ValueError(problem)
        return self

    @property
    def added(self) -> dict[str, PartTable]:
        """The tables of added parts that this scene has, by name."""
        named = ((name, getattr(self, name)) for name in added_tables())
        return {name: table for name, table in named if table is not None}

    def table(self, kind: type[_Added]) -> _Added | None:
        """Return the added table of this class, or None if the scene has none."""
        return next((table for table in self.added.values() if isinstance(table, kind)), None)

    def is_given(self, what: Literal["model", "force"]) -> bool:
        """Return whether an added part receives the model or the force from another machine."""
        return any(what in table.gives for table in self.added.values())

    @property
    def source(self) -> Literal["simulated", "replay", "devices"] | None:
        """Table of the follower's source, or None if the scene has no follower."""
        for name in ("simulated", "replay", "devices"):
            if getattr(self, name) is not None:
                return name
        return None

    @property
    def motion_limits(self) -> MotionLimits | None:
        """Limits of the follower's robot, or None if the run moves no robot."""
        return (self.simulated or self.devices) if self.commands else None

    def describe_motion_limits(self) -> str | None:
        """Return workspace, speed and acceleration limit in words, or None without a robot."""
        if self.motion_limits is None:
            return None
        where, how = self.motion_limits.describe()
        return f"{where}; {(self.link or Link()).limit_mm_s:g} mm/s; {how}"

    @property
    def commands(self) -> bool:
        """Whether the leader has an interface: a real handle or a simulated hand."""
        return self.hand is not None or self.handle is not None

    @property
    def normal(self) -> Axis:
        """The surface's normal axis."""
        return (self.texture or Texture()).normal

    @property
    def streams(self) -> bool:
        """Whether streamed vibration is played at any time."""
        silent = self.rendering is not None and self.rendering.before == "silent"
        return self.playout is not None and not silent

    @property
    def reports_contact(self) -> bool:
        """Whether the follower sends command, position and force of each tick beside its frames.

        The leader builds its model of the contact from these reports: for force feedback of the
        method ``model``, or for the hand's force if the handle measures none. With the method
        ``passive`` the follower sends energies instead.
        """
        feedback, handle = self.force_feedback, self.handle
        if feedback is not None and feedback.method != "streamed":
            return feedback.method == "model"
        concluded = handle is not None and handle.hand_force == "contact"
        return concluded and self.rendering is not None and self.link is not None

    @property
    def concealment(self) -> Literal["model", "repetition", "silence"]:
        """How gaps in the stream are concealed; ``model`` needs the compiled numerics."""
        if self.playout is None:
            return "silence"
        if self.playout.conceal != "auto":
            return self.playout.conceal
        return "repetition" if self.texture is None and self.rendering is None else "model"

    @property
    def numerics(self) -> bool:
        """Whether the leader needs the compiled numerics."""
        modelled = self.texture is not None or self.rendering is not None
        return modelled or self.concealment == "model"

    def channels(self) -> tuple[Channel, ...]:
        """Return the channels that the follower sends in this scene, in the frame's order."""
        wanted: set[Channel] = set()
        if self.texture is not None:
            wanted |= {"position", "force", "acceleration"}
        if self.rendering is not None and not self.commands:
            wanted |= {"position", "force"}
        if self.streams:
            wanted.add("acceleration")
        if self.force_feedback is not None:
            wanted.add("force")
        if self.reports_contact:
            wanted |= {"position", "force"}
        keeping = (self.recording, *self.added.values())
        kept = [table.channels for table in keeping if isinstance(table, Recording | PassingTable)]
        if "all" in kept or (kept and not wanted):
            wanted |= {"position", "force", "acceleration"}
        if wanted and self.session.orientation:
            wanted.add("orientation")
        return ordered_channels(wanted) if wanted else ()

    def keep_frames(self) -> int:
        """Return how many frames the follower keeps, to send lost ones again."""
        return round(self.link.keep_s * self.session.rate_hz) if self.link is not None else 0

    def parts(self, service: Service | None = None) -> dict[str, bool]:
        """Return by table name whether each part runs, of all parts or those of one service."""
        parts = {}
        for name, kind in PART_TABLES.items():
            table = getattr(self, name)
            services = kind.runs_in if table is None else table.services
            if service is None or service in services:
                parts[name] = table is not None
        return parts

    def dump(self) -> dict[str, Any]:
        """Return the resolved scene as JSON-serializable tables, without absent ones."""
        return self.model_dump(mode="json", exclude_none=True)


if TYPE_CHECKING:

    class Scene(SceneTables):
        """One run; a table that is absent (None) is a part that is left out."""
else:
    Scene = create_model(
        "Scene",
        __base__=SceneTables,
        __module__=__name__,
        __doc__="One run; a table that is absent (None) is a part that is left out.",
        **{name: (table | None, None) for name, table in added_tables().items()},
    )

PART_TABLES: Final[dict[str, type[OptionalTable]]] = {
    name: get_args(field.annotation)[0]
    for name, field in Scene.model_fields.items()
    if name != "session"
}
"""The class of every part's table, by the table's name."""

Rules = list[tuple[bool, str]]
"""For each invalid combination: whether the scene has it, and the error message."""


def _impossible(scene: SceneTables) -> list[str]:
    rules = [
        *_source_rules(scene),
        *_interface_rules(scene),
        *_rendering_rules(scene),
    ]
    for name in scene.added:
        if home := added_parts()[name].rules:
            rules += imported(home)(scene)
    return [problem for holds, problem in rules if holds]


def _source_rules(scene: SceneTables) -> Rules:
    sources = [n for n in ("simulated", "replay", "devices") if getattr(scene, n) is not None]
    passing = [n for n, table in added_tables().items() if issubclass(table, PassingTable)]
    parts = (
        *("network", "metrics", "monitor"),
        *passing,
        *("texture", "playout", "recording"),
        *(("force_feedback",) if not scene.is_given("force") else ()),
        *sources,
    )
    needs_link = [n for n in parts if getattr(scene, n) is not None]
    carried = ["texture", "playout", "force_feedback", "recording", *passing]
    return [
        (
            len(sources) > 1,
            f"[{'] and ['.join(sources)}] are both given: a follower has one source, keep one",
        ),
        (
            scene.link is None and bool(needs_link),
            f"[{needs_link[0] if needs_link else ''}] needs a follower: add [link]",
        ),
        (
            scene.link is not None and not sources,
            "[link] needs a follower's source: add one of [simulated], [replay], [devices]",
        ),
        (
            scene.link is not None and not scene.channels(),
            f"[link] would carry nothing: add {_any_of(carried)}",
        ),
        (
            bool(scene.session.orientation) and scene.replay is None and scene.devices is None,
            "[session] orientation is measured by a robot or recorded: add [devices] or [replay], "
            "or leave it out",
        ),
        (
            scene.texture is not None
            and scene.texture.normal != "z"
            and (scene.simulated is not None or scene.hand is not None),
            "[simulated] and [hand] have their surface across z: leave 'normal' of [texture] out",
        ),
        (
            scene.devices is not None
            and bool(scene.devices.tool_axes)
            and not scene.session.orientation,
            "tool_axes of [devices] are turned by the tool's orientation: add orientation = true "
            "to [session]",
        ),
    ]


def _any_of(names: list[str]) -> str:
    return " or ".join((", ".join(f"[{name}]" for name in names[:-1]), f"[{names[-1]}]"))


def _interface_rules(scene: SceneTables) -> Rules:
    return [
        (
            scene.hand is not None and scene.handle is not None,
            "[hand] and [handle] are both given: the leader has one interface, keep one",
        ),
        (
            scene.simulated is not None and not scene.commands,
            "[simulated] follows motion commands: add [hand] or [handle]",
        ),
        (
            scene.replay is not None and scene.commands,
            f"[replay] follows no commands: remove [{'hand' if scene.hand else 'handle'}] "
            "or take [simulated]",
        ),
        (
            scene.actuator is None and (scene.rendering is not None or scene.playout is not None),
            "[rendering] and [playout] drive an actuator: add [actuator]",
        ),
        (
            scene.force_feedback is not None and not scene.commands,
            "[force_feedback] is shown on the leader's interface: add [hand] or [handle]",
        ),
    ]


def _rendering_rules(scene: SceneTables) -> Rules:
    rendering = scene.rendering
    if rendering is None:
        return []
    return [
        (
            rendering.model is None and scene.texture is None and not scene.is_given("model"),
            "[rendering] needs a model: add [texture], or name a saved one with its key 'model'",
        ),
        (
            rendering.model is not None and rendering.before != "stream",
            "[rendering] renders its model from the start: leave 'before' out, or 'model'",
        ),
        (
            rendering.model is not None
            and scene.texture is not None
            and scene.texture.surfaces is not None,
            "[rendering] names one model, and [texture.surfaces] keeps one for each surface: "
            "leave 'model' out, or [texture.surfaces]",
        ),
        (
            rendering.generator is not None
            and (scene.texture is None or scene.texture.surfaces is not None),
            "generator of [rendering] learns from the strokes on one surface: add [texture], "
            "without [texture.surfaces]",
        ),
        (
            scene.link is None and not scene.commands,
            "[rendering] needs a hand's speed and force: add [hand], [handle] or [link]",
        ),
    ]
