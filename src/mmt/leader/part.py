"""The base class of the leader's parts: a few verbs, which do nothing unless overridden.

A part is one module with a class derived from `Part`, and a builder in `mmt.leader.building`,
which passes it the `Session` that all parts of a run share and the other parts that it needs. The
service calls its verbs. `Scene` is not imported here, since its class has the tables of added
parts, whose modules import this one.
"""

from collections.abc import Callable, Coroutine, Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, TypeVar

from mmt.core.arrays import FloatArray, RecordArray, Vector
from mmt.core.errors import MmtError
from mmt.core.running.ending import Ending
from mmt.core.running.ticking import Ticker
from mmt.core.verdict import Facts, Verdict, verdict
from mmt.devices.leader_reports import InterfaceState
from mmt.leader.run_log import Journal, RunLog

if TYPE_CHECKING:
    from prometheus_client.core import Metric

    from mmt.leader.remote import RemoteFollower
    from mmt.link.protocol import FollowerHello
    from mmt.link.serving.http import Page
    from mmt.scene import Scene
    from mmt.texture.online.updates import ModelUpdate


@dataclass
class Tick:
    """Data of a tick; the parts fill it in, in the order of their list.

    Attributes
    ----------
    now_ns
        The leader's monotonic time.
    elapsed
        Ticks since the last one, at least 1; all but the last of them were missed.
    streaming
        Whether a follower is connected, or the scene has no link.
    begun
        Whether a frame has come, or the scene has no link.
    state
        State of the hand, or None if it is not read.
    hand_lost
        Whether the handle is lost.
    overridden
        Whether this hand may not move the robot: the robot holds, or a listener moves it.
    operating
        State of the listener's hand that moves the robot, or None.
    offset_mm
        The follower's command minus the hand's position, after control was away.
    """

    now_ns: int = 0
    elapsed: int = 1
    streaming: bool = False
    begun: bool = False
    state: InterfaceState | None = None
    hand_lost: bool = False
    overridden: bool = False
    operating: InterfaceState | None = None
    offset_mm: Vector = (0.0, 0.0, 0.0)

    @property
    def moving(self) -> InterfaceState | None:
        """State of the hand that moves the robot: a listener's, or the leader's own."""
        return self.operating if self.overridden else self.state


class Part:
    """A part of the leader. Override the verbs it needs; they are called on the event loop."""

    @property
    def name(self) -> str:
        """Name of the part, for errors in opening or closing it."""
        return type(self).__name__

    # --- life cycle

    def connect(self) -> None:
        """Open devices and files before the link is opened; an exception ends the start."""

    def begin(self) -> None:
        """Start, after all parts are connected and the link is open."""

    def tasks(self) -> dict[str, Coroutine[Any, Any, None]]:
        """Return coroutines to run beside the ticks until the session ends, by name."""
        return {}

    async def finish(self) -> None:
        """Finish work under way; called if the session has ended without a fault."""

    async def stop(self) -> None:
        """Do last work while the link is still open; called however the session has ended."""

    def close(self) -> None:
        """Release everything. Parts are closed in the reverse order, even if one raises."""

    # --- while the session runs

    def tick(self, tick: Tick) -> None:
        """Do the work of a tick, a thousand times a second; may take a few microseconds."""

    def on_frames(self, frames: RecordArray, arrival_ns: int) -> None:
        """Use the newest frames (n,), n >= 1, which have just arrived."""

    def on_backfill(self, frames: RecordArray, arrival_ns: int) -> None:
        """Use frames (n,) that were missing and were sent again."""

    def on_settled(self) -> None:
        """Go on: some missing frames have come, or will not come."""

    def on_output(self, first_ns: int, mode: str, vibration_m_s2: FloatArray) -> None:
        """Use samples (n,) that the actuator has just been given, the first for this time."""

    def on_update(self, update: "ModelUpdate", seconds: float) -> None:
        """Use an update of the model, on which the modelling has worked for `seconds`."""

    def on_follower(self, hello: "FollowerHello") -> None:
        """Note that a follower has connected."""

    def on_lost(self) -> None:
        """Note that the follower is lost, perhaps for a while."""

    def on_event(self, event: dict[str, Any], sentence: str | None) -> None:
        """Note an event, with a sentence if the user is told."""

    def poll(self) -> None:
        """Check state, five times a second; an `MmtError` ends the session as failed."""

    # --- reports

    def faults(self) -> list[str]:
        """Return the part's faults, a sentence each."""
        return []

    def status(self) -> dict[str, Any]:
        """Return live figures, by the names of `LeaderStatus` or by the part's own names."""
        return {}

    def summary(self, duration_s: float) -> dict[str, Any]:
        """Return tables for the summary; tables of one name from several parts are joined."""
        _ = duration_s
        return {}

    def metrics(self) -> "Iterable[Metric]":
        """Return metrics; called in a thread, and only if the scene has ``[metrics]``."""
        return ()

    def pages(self) -> "list[Page]":
        """Return the pages to serve beside the link."""
        return []

    # --- orders from the user

    def signals(self) -> dict[str, Callable[[], None]]:
        """Return the functions to call at signals, by name, such as ``SIGUSR2``."""
        return {}

    def shown(self) -> dict[str, dict[str, Any]]:
        """Return headers of messages for the monitor's page, by kind of message."""
        return {}

    def orders(self) -> dict[str, Callable[[dict[str, Any]], str]]:
        """Return the functions that carry out orders of the monitor's page, by name.

        Each is called with an order, which is not trusted, and returns a sentence. It raises
        `InputError` if the order is wrong.
        """
        return {}


AnyPart = TypeVar("AnyPart", bound=Part)


class Parts:
    """The parts of a run, in the order in which their verbs are called."""

    def __init__(self) -> None:
        self._all: list[Part] = []

    def __iter__(self) -> Iterator[Part]:
        return iter(self._all)

    def get(self, part_class: type[AnyPart]) -> AnyPart | None:
        """Return the part of this class, or None if there is none."""
        return next((part for part in self if isinstance(part, part_class)), None)

    def add(self, part: Part) -> None:
        """Add a part after the others."""
        self._all.append(part)

    def verbs(self, verb: str) -> list[Callable[..., Any]]:
        """Return the bound methods of a verb, one for each part that overrides it."""
        usual = getattr(Part, verb)
        return [
            getattr(part, verb)
            for part in self
            if getattr(type(part), verb) is not usual or verb in vars(part)
        ]

    def connect(self) -> None:
        """Connect every part.

        Raises
        ------
        MmtError
            A part cannot be connected.
        """
        for part in self:
            try:
                part.connect()
            except MmtError:
                raise
            except Exception as error:
                reason = str(error) or type(error).__name__
                raise MmtError(f"{part.name} cannot be connected: {reason}") from error

    def call(self, verb: str, *arguments: object) -> None:
        """Call a verb of every part that overrides it."""
        for method in self.verbs(verb):
            method(*arguments)

    async def stop(self) -> list[str]:
        """Stop every part; return a sentence for each that could not be stopped."""
        problems = []
        for part in self:
            try:
                await part.stop()
            except Exception as error:  # noqa: BLE001 - the rest must still be stopped, and closed
                problems.append(f"stopping {part.name}: {error}")
        return problems

    def close(self) -> list[str]:
        """Close every part; return a sentence for each that could not be closed."""
        problems = []
        for part in reversed(list(self)):
            try:
                part.close()
            except Exception as error:  # noqa: BLE001 - the rest must still be closed
                problems.append(f"closing {part.name}: {error}")
        return problems


class Session:
    """State that the parts of a run share.

    Parameters
    ----------
    scene
        The scene to run.
    say
        Called with a sentence for the user.
    time_s
        Returns the session time.
    """

    def __init__(
        self,
        scene: "Scene",
        say: Callable[[str], None] | None = None,
        time_s: Callable[[], float] | None = None,
    ) -> None:
        self.scene: Final = scene
        self.rate_hz = float(scene.session.rate_hz)
        self.samples_per_frame = scene.session.samples_per_frame
        self.acceleration_rate_hz = float(scene.session.acceleration_rate_hz)
        """Rate of the vibration, streamed and rendered."""
        self.period_ns = round(1e9 / scene.session.rate_hz)
        self.log = RunLog()
        self.ending = Ending("completed")
        self.parts: Parts = Parts()
        self.time_s = time_s or (lambda: 0.0)
        self.journal = Journal(
            lambda event, sentence: self.parts.call("on_event", event, sentence),
            say or (lambda _: None),
            self.time_s,
        )
        self.remote: RemoteFollower | None = None
        """The follower, or None if the scene has no link."""
        self.ticker: Ticker | None = None
        """Calls the tick; None before there is one, and in simulated time."""
        self.verdict: Callable[[], Verdict] = lambda: verdict(Facts())
        """Returns the verdict on the run as it is now."""
