"""Factory of modellers: of one model, or of one model for each surface."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from mmt.texture.settings import ModellingSettings, surface_check_frames

if TYPE_CHECKING:
    from mmt.texture.online.modeller import OnlineModeller
    from mmt.texture.online.updates import ModelUpdate, SurfaceStatement
    from mmt.texture.surfaces.modeller import SurfaceModeller


class ModellerFactory:
    """Makes modellers of one model, or of one model for each surface.

    Parameters
    ----------
    settings
        Settings of the modelling; if ``surfaces`` is set, each surface has a model of its own.
    period_s
        Time between two updates of a model.
    """

    def __init__(self, settings: ModellingSettings, period_s: float) -> None:
        self._settings = settings
        self._update_frames = max(1, round(period_s * settings.rate_hz))
        self.frames_at_once = self._update_frames
        """Number of frames to give a modeller at a time."""
        if settings.surfaces is not None:
            check_frames = surface_check_frames(settings.rate_hz)
            self.frames_at_once = min(self._update_frames, check_frames)

    @property
    def numerics(self) -> list[str]:
        """Names of the modules to import before it models; the others follow from them."""
        several, field = self._settings.surfaces is not None, self._settings.method == "field"
        modeller = "mmt.texture.surfaces.modeller" if several else "mmt.texture.online.modeller"
        names = [modeller, "mmt.texture.model.rendered"]
        if field:
            names += ["mmt.texture.completion.uncertainty", "mmt.texture.field.shape_smoothing"]
        return names

    def make(
        self, statements: "Iterable[SurfaceStatement]" = ()
    ) -> "OnlineModeller | SurfaceModeller":
        """Return a new modeller.

        Parameters
        ----------
        statements
            Statements of persons on the surface; not used for a single model.
        """
        if self._settings.surfaces is None:
            from mmt.texture.online.modeller import OnlineModeller

            return OnlineModeller(self._settings)
        from mmt.texture.surfaces.modeller import SurfaceModeller

        modeller = SurfaceModeller(self._settings, self._update_frames)
        for statement in statements:
            modeller.state_surface(statement)
        return modeller

    @property
    def sequential(self) -> bool:
        """Whether each update must be carried out before the modeller continues."""
        return self._settings.surfaces is not None

    def is_finished(self, update: "ModelUpdate") -> bool:
        """Return whether no update will follow; with several surfaces one always may."""
        return update.stopped and self._settings.surfaces is None
