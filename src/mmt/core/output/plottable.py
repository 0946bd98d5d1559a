"""Base class of objects that a script or notebook can plot; plotting is in a higher layer."""

import importlib
from typing import TYPE_CHECKING

from mmt.core.extras import require

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class Plottable:
    """Base of objects that `mmt.plotting` can plot."""

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Plot this object with matplotlib; `mmt.plotting` lists what each class shows.

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
