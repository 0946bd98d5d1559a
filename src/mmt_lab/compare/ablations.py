"""The field method without one of its ingredients, by replacing one of its functions or constants.

The product has no option for this. A replacement lasts while a model is built, in this process
alone, and is undone afterwards. The replaced object is looked up by name, so that a renamed one
raises an error instead of comparing the field with itself.
"""

import pkgutil
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from types import MappingProxyType
from typing import Any, Final, NamedTuple
from unittest.mock import patch

import numpy as np

from mmt.texture.field.covariance import HYPERPRIOR
from mmt.texture.field.observations import BLOCK_VARIANCE, MOMENT_VARIANCE

Replace = Callable[[Any], Any]
"""From a function, a property or a constant to its replacement."""


class Ingredient(NamedTuple):
    """Ingredient in words, what is replaced, ``module:name``, and by what."""

    what: str
    target: str
    replace: Replace


def _medians_alone(settings: Callable[..., Any]) -> Callable[..., Any]:
    medians = np.array([[prior.median for prior in HYPERPRIOR.values()]])
    return lambda _, *, directed: medians[:, : settings(1, directed=directed).shape[1]]


def _nearest(points: Any, lsf: Any, _: Any, around: Any = None) -> Any:
    """Return the samples' own frequencies, then those of the sample nearest to each point."""
    if around is None:
        return lsf
    apart = np.linalg.norm(around[:, None] - points[None], axis=2)
    return np.concatenate([lsf, lsf[np.argmin(apart, axis=1)]])


def _constantly(value: Any) -> Replace:
    return lambda _: value


def _without_column(column: int) -> Replace:
    """Return a replacement that sets this hyperparameter of every setting to zero."""

    def replace(settings: Callable[..., Any]) -> Callable[..., Any]:
        def left(count: int, *, directed: bool) -> Any:
            every = settings(count, directed=directed).copy()
            every[:, column : column + 1] = 0.0
            return every

        return left

    return replace


_FIELD: Final = "mmt.texture.field"

INGREDIENTS: Final[Mapping[str, Ingredient]] = MappingProxyType(
    {
        "rough": Ingredient(
            "the rough departure, as wide as a cell",
            f"{_FIELD}.posterior:settings",
            lambda settings: partial(settings, rough=False),
        ),
        "mixture": Ingredient(
            "the mixture of settings: the median setting alone",
            f"{_FIELD}.posterior:settings",
            _medians_alone,
        ),
        "trust": Ingredient(
            "the heavy tail of a moment's error: every moment is believed",
            f"{_FIELD}.observations:_believed",
            _constantly(lambda off, _: np.ones(len(off))),
        ),
        "moments": Ingredient(
            "the scatter between moments, beyond the least",
            f"{_FIELD}.observations:_moment_variance",
            _constantly(lambda *_: MOMENT_VARIANCE),
        ),
        "slopes": Ingredient(
            "the prior of the slopes: 0 +- 2 for both",
            f"{_FIELD}.covariance:SLOPES",
            _constantly(((0.0, 2.0), (0.0, 2.0))),
        ),
        "blocks": Ingredient(
            "the scatter between blocks as it was met: that of a homogeneous surface",
            f"{_FIELD}.observations:_block_variance",
            _constantly(lambda _: BLOCK_VARIANCE),
        ),
        "steady": Ingredient(
            "that speed and force change by a factor of two at most within a block",
            f"{_FIELD}.blocks:_LARGEST_CHANGE",
            _constantly(1e9),
        ),
        "ridges": Ingredient(
            "the departure that is the same for a stroke and its return",
            f"{_FIELD}.posterior:settings",
            _without_column(4),
        ),
        "nap": Ingredient(
            "the departure that is not",
            f"{_FIELD}.posterior:settings",
            _without_column(6),
        ),
        "lengths": Ingredient(
            "the choice of the shapes' lengths by their evidence: 0.5 and 0.7",
            f"{_FIELD}.shape_smoothing:_SCALES",
            _constantly(((0.5,), (0.7,))),
        ),
        "smoothing": Ingredient(
            "the smoothing of the spectra's shapes",
            f"{_FIELD}.shape_smoothing:smoothed",
            _constantly(_nearest),
        ),
        "high-pass": Ingredient(
            "giving back what the high-pass takes",
            "mmt.texture.model.fits:_given_back",
            lambda own: lambda rate_hz: np.ones_like(own(rate_hz)),
        ),
    }
)
"""Ingredients of the field by name."""


def without(name: str) -> AbstractContextManager[object]:
    """Leave out one of `INGREDIENTS` inside the block; nothing if the name is empty.

    Models must be built and evaluated inside the block.
    """
    if not name:
        return nullcontext()
    _, target, replace = INGREDIENTS[name]
    return patch(target.replace(":", "."), replace(pkgutil.resolve_name(target)))
