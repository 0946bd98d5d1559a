"""Selection of a model's points: removes outliers and redundant points.

The result of `select` does not depend on the order of the points;
`mmt_methods.selection.published` is the algorithm of the paper. Both work on plain arrays.
"""

from mmt_methods.selection.points import ModelPoints
from mmt_methods.selection.selecting import Selection, SelectionSettings, select

__all__ = ["ModelPoints", "Selection", "SelectionSettings", "select"]
