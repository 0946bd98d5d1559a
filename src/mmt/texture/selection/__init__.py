"""Selection of a model's points: outliers and redundant ones removed.

`published` is the algorithm of the paper, `select` the one that does not depend on the order
of the points. Both work on plain arrays in any number of dimensions.
"""

from mmt.texture.selection.points import ModelPoints
from mmt.texture.selection.published import PublishedSelection, select_published
from mmt.texture.selection.selecting import Selection, SelectionSettings, select

__all__ = [
    "ModelPoints",
    "PublishedSelection",
    "Selection",
    "SelectionSettings",
    "select",
    "select_published",
]
