"""What a part of the leader is: a few verbs, each of which does nothing unless it is overridden.

A part is one module with a class derived from `Part`, and a builder in `mmt.leader.building`,
which passes it the `Session` that all parts of a run share and the other parts that it needs. The
service calls its verbs.
"""

from collections.abc import Callable, Coroutine, Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Protocol, TypeVar

from mmt.core.arrays import FloatArray, RecordArray
from mmt.core.ending import Ending
from mmt.core.errors import MmtError
from mmt.core.ticking import Ticker
from mmt.core.verdict import Facts, Verdict, verdict
from mmt.devices.protocols import InterfaceState, Vector
from mmt.leader.run_log import Journal, RunLog
from mmt.scene import Scene

if TYPE_CHECKING:
    from prometheus_client.core import Metric

    from mmt.leader.backfill import Backfill
    from mmt.link.http import Page
    from mmt.link.protocol import FollowerHello, LinkStatistics
    from mmt.link.server import LeaderServer


@dataclass
class Tick:
    """What is known in a tick; the parts fill it in, in the order of their list.

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
        The hand's state, None where it is not read.
    hand_lost
        Whether the handle is lost.
    given
        Whether the robot is not this hand's to move: it holds, or a listener moves it.
    operating
        State of the listener's hand that moves the robot, None where none does.
    offset_mm
        What the follower's command has more than the hand's position, since control was away.
    """

    now_ns: int = 0
    elapsed: int = 1
    streaming: bool = False
    begun: bool = False
    state: InterfaceState | None = None
    hand_lost: bool = False
    given: bool = False
    operating: InterfaceState | None = None
    offset_mm: Vector = (0.0, 0.0, 0.0)

    @property
    def moving(self) -> InterfaceState | None:
        """State of the hand that moves the robot: a listener's, or the leader's own."""
        return self.operating if self.given else self.state


class Part:
    """A part of the leader. Override what it needs; the verbs are called on the event loop."""

    @property
    def name(self) -> str:
        """What a person calls it, where it cannot be opened or closed."""
        return type(self).__name__

    # --- its life

    def connect(self) -> None:
        """Open devices and files before the link is opened; what it raises ends the start."""

    def begin(self) -> None:
        """Start, now that nothing else keeps the session from starting."""

    def tasks(self) -> dict[str, Coroutine[Any, Any, None]]:
        """Return coroutines to run beside the ticks until the session ends, by name."""
        return {}

    async def finish(self) -> None:
        """Finish what is half done; the session has ended as it should."""

    async def stop(self) -> None:
        """Say goodbye, while the link is still open; the session has ended in any way."""

    def close(self) -> None:
        """Release everything. Parts are closed in the reverse order, also when one raises."""

    # --- while it runs

    def tick(self, tick: Tick) -> None:
        """Do what is to be done a thousand times a second; a few microseconds."""

    def on_frames(self, frames: RecordArray, arrival_ns: int) -> None:
        """Use the newest frames (n,), n >= 1, which have just arrived."""

    def on_backfill(self, frames: RecordArray, arrival_ns: int) -> None:
        """Use frames (n,) that were missing and were sent again."""

    def on_settled(self) -> None:
        """Go on: some of the missing frames have come, or will not come."""

    def on_output(self, first_ns: int, mode: str, vibration_m_s2: FloatArray) -> None:
        """Use samples (n,) that the actuator has just been given, the first for this time."""

    def on_follower(self, hello: "FollowerHello") -> None:
        """Take note of a follower that has connected."""

    def on_lost(self) -> None:
        """Take note that the follower is lost, perhaps for a while."""

    def on_event(self, event: dict[str, Any], sentence: str | None) -> None:
        """Take note of an event; it has a sentence where a person is told."""

    def look(self) -> None:
        """Check, five times a second; an `MmtError` ends the session as failed."""

    # --- what it says

    def faults(self) -> list[str]:
        """Return what is not as it should be, a sentence each."""
        return []

    def status(self) -> dict[str, Any]:
        """Return live figures, by the names of `LeaderStatus` or by names of its own."""
        return {}

    def summary(self, duration_s: float) -> dict[str, Any]:
        """Return tables for the summary; tables of one name from several parts are joined."""
        _ = duration_s
        return {}

    def metrics(self) -> "Iterable[Metric]":
        """Return metrics, called in a thread; only where the scene has [metrics]."""
        return ()

    def pages(self) -> "list[Page]":
        """Return what is served beside the link."""
        return []

    # --- what a person does

    def signals(self) -> dict[str, Callable[[], None]]:
        """Return what is called at signals, by their names, such as ``SIGUSR2``."""
        return {}

    def shown(self) -> dict[str, dict[str, Any]]:
        """Return what the monitor's page shows of it: headers of messages, by their kinds."""
        return {}

    def orders(self) -> dict[str, Callable[[dict[str, Any]], str]]:
        """Return the orders of the monitor's page that it carries out, by their names.

        Each is called with an order, which is not trusted, and returns a sentence; an
        `InputError` says what is wrong with it.
        """
        return {}


AnyPart = TypeVar("AnyPart", bound=Part)


class Parts:
    """The parts of a run, in the order in which their verbs are called."""

    def __init__(self) -> None:
        self._all: list[Part] = []
        self._on_frames: list[Callable[[RecordArray, int], None]] = []

    def __iter__(self) -> Iterator[Part]:
        return iter(self._all)

    def of(self, kind: type[AnyPart]) -> AnyPart | None:
        """Return the part of this class, None if there is none."""
        return next((part for part in self if isinstance(part, kind)), None)

    def add(self, part: Part) -> None:
        """Add a part behind the others."""
        self._all.append(part)

    def verbs(self, verb: str) -> list[Callable[..., Any]]:
        """Return a verb's methods of the parts that override it, ready to be called."""
        usual = getattr(Part, verb)
        return [
            getattr(part, verb)
            for part in self
            if getattr(type(part), verb) is not usual or verb in vars(part)
        ]

    def connect(self) -> None:
        """Open what the parts need.

        Raises
        ------
        MmtError
            One of them cannot be opened.
        """
        for part in self:
            try:
                part.connect()
            except MmtError:
                raise
            except Exception as error:
                reason = str(error) or type(error).__name__
                raise MmtError(f"{part.name} cannot be connected: {reason}") from error
        self._on_frames = self.verbs("on_frames")

    def on_frames(self, frames: RecordArray, arrival_ns: int) -> None:
        """Hand the newest frames (n,) to every part that uses them."""
        for use in self._on_frames:
            use(frames, arrival_ns)

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


class Remote(Protocol):
    """The follower, as the parts see it; see `mmt.leader.remote.RemoteFollower`."""

    backfill: "Backfill"
    server: "LeaderServer | None"

    @property
    def connected(self) -> bool:
        """Whether it is connected."""

    @property
    def has_begun(self) -> bool:
        """Whether a frame has come."""

    @property
    def awaited(self) -> str:
        """What the session waits for, "" while frames come."""

    @property
    def faults(self) -> list[str]:
        """What is not as it should be, a sentence each."""

    @property
    def time_s(self) -> float:
        """Session time of its newest frame."""

    @property
    def statistics(self) -> "LinkStatistics | None":
        """What the link counts."""

    @property
    def clock_offset_ns(self) -> int | None:
        """Offset of its clock, None where it is not known."""

    @property
    def follower_time_ns(self) -> int:
        """Time of its newest frame by its own clock; 0 before the first of a connection."""

    def command(self, now_ns: int, position_mm: Vector) -> None:
        """Command a position (mm)."""

    def send_extra(self, records: RecordArray) -> None:
        """Send records (n,) of the force feedback's method."""


class Session:
    """What the parts of a run share.

    Parameters
    ----------
    scene
        What is run.
    say
        Called with a sentence that a person wants to know.
    time_s
        Gives the session time.
    """

    def __init__(
        self,
        scene: Scene,
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
        self.remote: Remote | None = None
        """The follower, None where the scene has no link."""
        self.ticker: Ticker | None = None
        """Calls the tick; None before there is one, and in simulated time."""
        self.verdict: Callable[[], Verdict] = lambda: verdict(Facts())
        """Gives the verdict on the run as it is now."""
