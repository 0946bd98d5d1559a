"""The monitor's interface to a running leader."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol

from mmt.core.verdict import Verdict
from mmt.scene import Scene

if TYPE_CHECKING:
    from mmt.core.ticking import Ticker
    from mmt.link.server import LeaderServer
    from mmt.texture.model.texture_model import TextureModel
    from mmt.texture.online.updates import ModelUpdate


class LeaderView(Protocol):
    """A running leader; reading its properties does not block, orders may take time.

    Attributes
    ----------
    scene
        The leader's scene.
    session_id
        Identifies the session.
    """

    scene: Scene
    session_id: str

    @property
    def time_s(self) -> float:
        """Session time."""

    @property
    def outcome(self) -> str:
        """Outcome of the session, or the outcome to expect while it runs."""

    @property
    def verdict(self) -> Verdict:
        """The current verdict on the run."""

    @property
    def server(self) -> "LeaderServer | None":
        """The link, or None without a link."""

    @property
    def ticker(self) -> "Ticker | None":
        """The ticker, or None before the start."""

    @property
    def playout_delay_ms(self) -> float | None:
        """Delay of the playout, or None without playout."""

    @property
    def mode(self) -> str | None:
        """Source of the vibration that is played, or None without an actuator."""

    @property
    def forced(self) -> Literal["streamed", "synthesized"] | None:
        """Source of vibration that the user has selected, or None if the criterion decides."""

    @property
    def renders(self) -> bool:
        """Whether vibration can be rendered from a model."""

    @property
    def frozen(self) -> bool | None:
        """Whether updates of the model are suspended; None if no model is built."""

    @property
    def update(self) -> "ModelUpdate | None":
        """The newest update of the model, or None before the first."""

    @property
    def model(self) -> "TextureModel | None":
        """The model being built; before the first update the saved model, if any."""

    @property
    def criteria_s(self) -> tuple[float | None, float | None]:
        """Session times at which the start and the stop criterion were met."""

    @property
    def surfaces(self) -> tuple[int, list[int]] | None:
        """The number of the surface under the tool, and the numbers of all known surfaces.

        None if surfaces are not distinguished, or before the first update.
        """

    @property
    def shown(self) -> dict[str, dict[str, Any]]:
        """Headers of messages from other parts, by kind."""

    @property
    def orders(self) -> dict[str, Callable[[dict[str, Any]], str]]:
        """Orders that other parts carry out, by name; see `mmt.leader.part.Part.orders`."""

    @property
    def recording(self) -> Path | None:
        """The file of the running recording, or None."""

    # --- orders

    def log_event(self, sentence: str, **details: object) -> None:
        """Log an event of the session, and record it."""

    def reset_model(self) -> None:
        """Discard the model and start a new one."""

    def freeze(self, frozen: bool) -> None:
        """Suspend updates of the model, or resume them."""

    def state_surface(self, surface: int) -> None:
        """Set the surface under the tool, as stated by the user."""

    def force(self, mode: Literal["streamed", "synthesized"] | None) -> None:
        """Select the source of vibration, or let the criterion decide (None)."""

    async def start_recording(self, path: Path) -> None:
        """Record into a new file."""

    async def end_recording(self) -> tuple[Path, int]:
        """End the recording; return its file and number of frames."""
