"""The part that shows the run to a browser, and the page's view of the leader."""

from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from mmt.core.arrays import FloatArray, RecordArray
from mmt.core.verdict import Verdict
from mmt.leader.part import Part, Session, Tick
from mmt.scene import Monitor
from mmt.web.monitor.running import LeaderMonitor

if TYPE_CHECKING:
    from mmt.core.ticking import Ticker
    from mmt.leader.modelling.pipeline import Modelling
    from mmt.leader.output.model_output import ModelOutput
    from mmt.leader.output.stream import StreamedVibration
    from mmt.leader.output.vibration import VibrationPart
    from mmt.leader.recording import RecordingPart
    from mmt.link.http import Page
    from mmt.link.server import LeaderServer
    from mmt.texture.model.texture_model import TextureModel
    from mmt.texture.online.updates import ModelUpdate


class SessionView:
    """A session as the monitor sees it; see `mmt.web.monitor.view.LeaderView`.

    Parameters
    ----------
    session
        Session of the run.
    completing, recording, modelling, playout, vibration
        Parts that the page shows, or that its controls act on.
    """

    def __init__(
        self,
        session: Session,
        completing: "ModelOutput",
        recording: "RecordingPart",
        *,
        modelling: "Modelling | None",
        playout: "StreamedVibration | None",
        vibration: "VibrationPart | None",
    ) -> None:
        self._session = session
        self._log = session.log
        self.scene = session.scene
        self.session_id = session.log.session_id
        self._completing, self._recording, self._modelling = completing, recording, modelling
        self._playout, self._vibration = playout, vibration

    @property
    def time_s(self) -> float:
        """Session time."""
        return self._session.time_s()

    @property
    def outcome(self) -> str:
        """How the session has ended."""
        return self._session.ending.outcome

    @property
    def verdict(self) -> Verdict:
        """The verdict on the run as it is now."""
        return self._session.verdict()

    @property
    def server(self) -> "LeaderServer | None":
        """The link."""
        return self._session.remote.server if self._session.remote is not None else None

    @property
    def ticker(self) -> "Ticker | None":
        """The ticker, or None before there is one."""
        return self._session.ticker

    @property
    def playout_delay_ms(self) -> float | None:
        """Delay of the playout."""
        return None if self._playout is None else self._playout.buffer.statistics().delay_ms

    @property
    def mode(self) -> str | None:
        """Which vibration is played."""
        return None if self._vibration is None else self._vibration.switch.mode

    @property
    def forced(self) -> Literal["streamed", "synthesized"] | None:
        """Which vibration a person has fixed, or None."""
        return self._completing.forced

    @property
    def renders(self) -> bool:
        """Whether vibration can be rendered from a model."""
        return self._completing.renders

    @property
    def frozen(self) -> bool | None:
        """Whether the model is frozen; None if nothing is modelled."""
        return None if self._modelling is None else self._modelling.frozen

    @property
    def update(self) -> "ModelUpdate | None":
        """The newest update of the model."""
        return self._log.update

    @property
    def model(self) -> "TextureModel | None":
        """The model that grows, or the saved one."""
        if self._log.update is not None:
            return self._log.update.model
        return None if self._log.update_seconds else self._completing.rendered

    @property
    def criteria_s(self) -> tuple[float | None, float | None]:
        """Session times at which the criteria were met."""
        return self._log.start_s, self._log.stop_s

    @property
    def surfaces(self) -> tuple[int, list[int]] | None:
        """The number of the surface under the tool, and the numbers of all known surfaces."""
        found = self._log.surfaces
        return None if found is None else (found.current, sorted(found.entries))

    @property
    def shown(self) -> dict[str, dict[str, Any]]:
        """Headers of messages that other parts show, by kind of message."""
        return {k: header for shown in self._verbs("shown") for k, header in shown().items()}

    @property
    def orders(self) -> dict[str, Callable[[dict[str, Any]], str]]:
        """Orders that other parts carry out, by name."""
        return {k: order for orders in self._verbs("orders") for k, order in orders().items()}

    def _verbs(self, verb: str) -> list[Callable[..., dict[str, Any]]]:
        return self._session.parts.verbs(verb)

    @property
    def recording(self) -> Path | None:
        """The file of the running recording, or None."""
        recorder = self._recording.running
        return None if recorder is None else recorder.path

    def log_event(self, sentence: str, **details: object) -> None:
        """Record an event and tell the user."""
        self._session.journal.event(sentence, **details)

    def reset_model(self) -> None:
        """Begin the model anew."""
        self._completing.reset(self.time_s)

    def freeze(self, frozen: bool) -> None:
        """Freeze the model, or let it grow again."""
        if self._modelling is not None:
            self._modelling.freeze(frozen)

    def state_surface(self, surface: int) -> None:
        """Set the surface under the tool from now on, as stated by a person."""
        if self._modelling is not None:
            self._modelling.state_surface(surface)

    def force(self, mode: Literal["streamed", "synthesized"] | None) -> None:
        """Fix one vibration, or let the criterion decide (None)."""
        self._completing.force(mode)

    async def start_recording(self, path: Path) -> None:
        """Record into a new file."""
        await self._recording.start(path)

    async def end_recording(self) -> tuple[Path, int]:
        """End the recording."""
        recorder = await self._recording.end()
        return recorder.path, recorder.frames


class MonitorPart(Part):
    """Give the monitor its data, and serve its page.

    Parameters
    ----------
    session
        Session of the run.
    view
        The monitor's view of the session.
    table
        The scene's ``[monitor]``.
    """

    def __init__(self, session: Session, view: SessionView, table: Monitor) -> None:
        self._session = session
        self.monitor = LeaderMonitor(view, table)
        self._tap = self.monitor.tap

    def tasks(self) -> dict[str, Coroutine[Any, Any, None]]:
        """Return the task that reads the session's state and publishes it."""
        return {"monitor": self.monitor.run()} if self._session.remote is not None else {}

    async def stop(self) -> None:
        """Give the viewers the last state and the session's outcome."""
        self.monitor.end()

    def pages(self) -> "list[Page]":
        """Return the monitor's page."""
        return [self.monitor.page]

    def on_frames(self, frames: RecordArray, arrival_ns: int) -> None:
        """Keep frames (n,) for the page."""
        _ = arrival_ns
        self._tap.add_frames(frames)

    def on_output(self, first_ns: int, mode: str, vibration_m_s2: FloatArray) -> None:
        """Keep the played vibration (n,) for the page."""
        _ = first_ns, mode
        self._tap.add_output(vibration_m_s2)

    def tick(self, tick: Tick) -> None:
        """Keep the state of the hand that moves the robot for the page."""
        self._tap.state = tick.moving

    def status(self) -> dict[str, Any]:
        """Return the number of viewers."""
        return {"viewers": len(self.monitor.viewers)}

    def on_event(self, event: dict[str, Any], sentence: str | None) -> None:
        """Show the sentence of an event of which the user is told."""
        if sentence is not None:
            self.monitor.note(event["time_s"], sentence)
