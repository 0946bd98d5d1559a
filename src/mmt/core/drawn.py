"""What draws itself in a script or a notebook, by modules that stand above all else."""

import importlib
from typing import TYPE_CHECKING

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
