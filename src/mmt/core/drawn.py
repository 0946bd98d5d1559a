"""What draws itself in a script or a notebook, by modules that stand above all else."""

import importlib
from typing import TYPE_CHECKING

from mmt.core.errors import InputError
from mmt.core.extras import require

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class Drawn:
    """Base of what can be plotted."""

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Plot it with matplotlib; what is plotted is in `mmt.plotting`.

        Parameters
        ----------
        ax
            Axes to plot on; None for those of a new figure.

        Returns
        -------
        Axes

        Raises
        ------
        InputError
            matplotlib is not installed, or there is nothing to plot.
        """
        require("matplotlib")
        axes: Axes = importlib.import_module("mmt.plotting").plot(self, ax)
        return axes


class PlayableInNotebook(Drawn):
    """Base of models, which a notebook shows as a page that plays them."""

    def _repr_html_(self) -> str | None:
        form = importlib.import_module("mmt.texture.model.json_form").model_json(self, "model")
        try:
            return str(importlib.import_module("mmt.web.texture_page").playing_element(form))
        except InputError:  # too large for a page: its repr is shown
            return None
