"""A generator whose output is checked; a sentence says what is wrong with it."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import MmtError, located

if TYPE_CHECKING:
    from mmt_methods.generators.protocol import VibrationGenerator


class GeneratorFault(MmtError):  # noqa: N818 - it is what was found
    """A builder or generator has done something wrong; the message names it and the fault."""


class GuardedGenerator:
    """Ask a generator for blocks, and check each block.

    Parameters
    ----------
    name
        Name of the generator in messages.
    generator
        Result of a builder.
    limit_m_s2
        Limit of the actuator, to which the output is clipped.

    Attributes
    ----------
    generator
        The generator given.
    directed
        Whether the generator is asked by velocity x, y and force, not by speed and force.
    samples, clipped
        Number of samples so far, and of clipped ones among them.

    Raises
    ------
    GeneratorFault
        The generator has no method ``reset`` or ``generate``.
    """

    def __init__(
        self, name: str, generator: "VibrationGenerator", *, limit_m_s2: float = 60.0
    ) -> None:
        self.name = name
        self.generator = generator
        self.limit_m_s2 = limit_m_s2
        for method in ("reset", "generate"):
            if not callable(getattr(generator, method, None)):
                raise GeneratorFault(
                    f"generator {name}: the builder returned {type(generator).__name__}, which has "
                    f"no method {method}"
                )
        self.directed = bool(getattr(generator, "directed", False))
        self.samples = self.clipped = 0

    def reset(self, seed: int) -> None:
        """Start over.

        Raises
        ------
        GeneratorFault
            The generator has raised an exception.
        """
        with told_as_fault(self.name, "reset"):
            self.generator.reset(seed)

    def render(self, *inputs: FloatArray) -> FloatArray:
        """Return the next n samples of vibration in m/s2.

        Parameters
        ----------
        *inputs
            Speed and normal force at each sample or, if `directed`, velocity x, y and normal
            force; each of shape (n,), n at least 1.

        Raises
        ------
        GeneratorFault
            The generator has raised an exception, or has not given n finite numbers.
        """
        with told_as_fault(self.name, "generate"):
            given = self.generator.generate(*(np.array(each) for each in inputs))
        values = self._checked(given, len(inputs[0]))
        bounded = np.clip(values, -self.limit_m_s2, self.limit_m_s2)
        self.samples += len(values)
        self.clipped += int(np.count_nonzero(bounded != values))
        return bounded

    def _checked(self, given: Any, count: int) -> FloatArray:
        """Return the output as an array (count,), or raise the fault."""
        try:
            values = np.asarray(given, dtype=np.float64)
        except (TypeError, ValueError):
            fault = f"{type(given).__name__}, no array of numbers"
        else:
            if values.shape == (count,) and np.isfinite(values).all():
                return values
            fault = "a sample that is no number"
            if values.shape != (count,):
                fault = f"the shape {values.shape} for inputs of {count} samples: {(count,)} is due"
        raise GeneratorFault(f"generator {self.name}: generate gave {fault}")


@contextmanager
def told_as_fault(name: str, what: str) -> Iterator[None]:
    """Raise the exceptions of a generator's own code as a `GeneratorFault`."""
    try:
        yield
    except Exception as error:
        raise GeneratorFault(f"generator {name}: {what} raised {located(error)}") from error
