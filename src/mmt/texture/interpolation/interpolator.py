"""What every interpolator is made of: an evaluator, an interpolant, and a builder.

The builder turns the vertices of a model into an `Interpolant`: a few arrays and the compiled
evaluator that reads them. Rendering and whole arrays alike evaluate it inside other kernels by
`evaluate_into`, a call through the evaluator's address: without the interpreter lock, without
allocation, and without those kernels knowing which interpolators there are.

An evaluator writes a level, which is not negative, and line spectral frequencies (LSF) that
ascend strictly in (0, pi). Convex combinations of the vertices' values are such; anything else
is made valid by the evaluator.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final, Protocol, cast

import numpy as np
import numpy.typing as npt
from numba import types
from numba.extending import intrinsic

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.compiled import kernel
from mmt.texture.autoregression.order_limit import LARGEST_ORDER
from mmt.texture.interpolation.vertices import Vertices

SCRATCH: Final = 4 * LARGEST_ORDER + 1
"""Numbers of scratch that an evaluator may use."""

State = Mapping[str, npt.NDArray[Any]]
"""Arrays by their names in a model file; each name begins with a word of the interpolator's."""

Function = Callable[
    [FloatArray, IntArray, FloatArray, int, FloatArray, FloatArray, FloatArray], int
]

_SIGNATURE: Final = "i8(f8[:, ::1], i8[:, ::1], f8[:, ::1], i8, f8[::1], f8[::1], f8[::1])"

_NO_LINKS: Final[IntArray] = np.zeros((0, 0), dtype=np.int64)
_NO_TAIL: Final[FloatArray] = np.zeros((0, 0))


class Evaluator:
    """A function compiled to evaluate an interpolant at a point; use it as a decorator.

    Parameters
    ----------
    function
        ``function(rows, links, tail, hint, point, values, scratch) -> int``, at the top of its
        module, in the subset of Python that numba compiles. `rows`, `links` and `tail` are those
        of the `Interpolant`, and `point` (d,) is normalised and finite. It writes level and LSF
        into `values` (1 + order,) and may use `scratch`, which holds `SCRATCH` numbers or more.
        `hint` is what the last call returned, where a search may begin: any integer.
    """

    def __init__(self, function: Function) -> None:
        self.__module__, self.__qualname__ = function.__module__, function.__qualname__
        self.__doc__ = function.__doc__
        self._kernel = cast(Any, kernel(_SIGNATURE)(function))

    @cached_property
    def address(self) -> int:
        """Where its machine code is in this process, for `evaluate_into`."""
        (compiled,) = self._kernel.overloads.values()
        library, symbol = compiled.library, compiled.fndesc.llvm_func_name
        return int(library.get_pointer_to_function(symbol))

    def __reduce__(self) -> str:
        return self.__qualname__  # pickled by name: another process has it at another address


@dataclass(frozen=True, eq=False)
class Interpolant:
    """Values over the input space; an interpolator may derive from it to remember more.

    Attributes
    ----------
    evaluator
        The compiled function that reads the arrays.
    rows
        Shape (n, columns), by convention d coordinates, then values or weights.
    links
        Integers, such as simplices; shape (t, columns), (0, 0) where there are none.
    tail
        Further numbers, shape (l, columns), (0, 0) where there are none.
    """

    evaluator: Evaluator
    rows: FloatArray
    links: IntArray = field(default_factory=lambda: _NO_LINKS)
    tail: FloatArray = field(default_factory=lambda: _NO_TAIL)

    def state(self) -> State:
        """Return what a model file stores, by which the same builder builds it as it is."""
        return {}


class Builder(Protocol):
    """Build an interpolant."""

    def __call__(
        self, vertices: Vertices, previous: Interpolant | None, state: State | None
    ) -> Interpolant:
        """Build it from distinct points that span the space.

        Parameters
        ----------
        vertices
            Points and values, samples first, then the boundary.
        previous
            What the same builder returned for an earlier state of the model, None at first:
            most of its points are still there, and boundary points have kept their place,
            but not their values.
        state
            What `Interpolant.state` was of the same vertices, by which it is built as it was;
            there may be further arrays in it. None where all is to be chosen.

        Raises
        ------
        InputError
            `state` lacks an array, or one is out of its range.
        """
        ...


_ARGUMENTS: Final = (
    types.Array(types.float64, 2, "C"),
    types.Array(types.int64, 2, "C"),
    types.Array(types.float64, 2, "C"),
    types.int64,
    types.Array(types.float64, 1, "C"),
    types.Array(types.float64, 1, "C"),
    types.Array(types.float64, 1, "C"),
)


def _evaluate_into(
    _typing: Any,
    address: Any,
    rows: Any,
    links: Any,
    tail: Any,
    hint: Any,
    point: Any,
    values: Any,
    scratch: Any,
) -> Any:
    """Call an evaluator by its address, inside a kernel; arguments and result are its own."""
    del address, rows, links, tail, hint, point, values, scratch  # all have one type each

    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        convention, kinds = context.call_conv, signature.args[1:]
        pointer = convention.get_function_type(signature.return_type, kinds).as_pointer()
        function = builder.inttoptr(given[0], pointer)
        _, result = convention.call_function(
            builder, function, signature.return_type, kinds, given[1:]
        )
        return result

    return types.int64(types.int64, *_ARGUMENTS), generate


evaluate_into: Any = intrinsic(_evaluate_into)
"""``evaluate_into(address, rows, links, tail, hint, point, values, scratch) -> int``.

For kernels alone; see `Evaluator`."""
