"""What the monitor sees of a running leader, and may ask of it."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol

from mmt.core.verdict import Verdict
from mmt.scene import Scene

if TYPE_CHECKING:
    from mmt.core.ticking import Ticker
    from mmt.link.server import LeaderServer
    from mmt.texture.model.texture_model import TextureModel
    from mmt.texture.online.work import ModelUpdate


class LeaderView(Protocol):
    """A running leader. It is read some 25 times a second, and never waited for but by orders.

    Attributes
    ----------
    scene
        What it runs.
    session_id
        Names the session.
    """

    scene: Scene
    session_id: str

    @property
    def time_s(self) -> float:
        """Session time."""

    @property
    def outcome(self) -> str:
        """How the session has ended, or will if nothing happens."""

    @property
    def verdict(self) -> Verdict:
        """The verdict on the run as it is now."""

    @property
    def server(self) -> "LeaderServer | None":
        """The link, None without one."""

    @property
    def ticker(self) -> "Ticker | None":
        """What ticks."""

    @property
    def playout_delay_ms(self) -> float | None:
        """Delay of the playout, None without one."""

    @property
    def mode(self) -> str | None:
        """Which vibration is played, None without an actuator."""

    @property
    def forced(self) -> Literal["streamed", "synthesized"] | None:
        """Which vibration a person holds on to."""

    @property
    def renders(self) -> bool:
        """Whether vibration can be rendered from a model."""

    @property
    def frozen(self) -> bool | None:
        """Whether the model is left as it is; None where none is built."""

    @property
    def update(self) -> "ModelUpdate | None":
        """The newest update of the model, None before the first."""

    @property
    def model(self) -> "TextureModel | None":
        """The model that grows; until the first update the saved one, if there is one."""

    @property
    def criteria_s(self) -> tuple[float | None, float | None]:
        """Session times at which the start and the stop criterion were met."""

    @property
    def surfaces(self) -> tuple[int, list[int]] | None:
        """The number of the surface under the tool, and those of all that are known.

        None if surfaces are not told apart, or before the first update.
        """

    @property
    def shown(self) -> dict[str, dict[str, Any]]:
        """What other parts show: headers of messages, by their kinds."""

    @property
    def orders(self) -> dict[str, Callable[[dict[str, Any]], str]]:
        """Orders that other parts carry out, by their names; see `mmt.leader.part.Part.orders`."""

    @property
    def recording(self) -> Path | None:
        """The file that is recorded into, None where none is."""

    # --- orders

    def tell(self, sentence: str, **details: object) -> None:
        """Note an event."""

    def reset_model(self) -> None:
        """Begin the model anew."""

    def freeze(self, frozen: bool) -> None:
        """Leave the model as it is, or let it grow again."""

    def say_surface(self, surface: int) -> None:
        """Take a person's word that the tool is on this surface from now on."""

    def force(self, mode: Literal["streamed", "synthesized"] | None) -> None:
        """Hold on to one vibration, or let the criterion decide (None)."""

    async def start_recording(self, path: Path) -> None:
        """Record into a new file."""

    async def end_recording(self) -> tuple[Path, int]:
        """End the recording; return its file and how many frames are in it."""
