"""Render textures inside another program: open, touch, render, close."""

import math
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError, MmtError
from mmt.models import find_model
from mmt.rendering.generating import OutputGenerator
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.synthesis.generation import VibrationFilter, estimate

Source = Path | str | TextureModel
"""A model file or the name of a shipped model, or a model."""

Sink = Callable[[FloatArray], object]

_BLOCK_S: Final = 0.005
_JOIN_S: Final = 2.0


class Textures:
    """Open textures: result of `open_textures` and argument of the other three calls.

    Touch and estimate are each replaced by one assignment, so that the hand, the estimates and the
    samples may be in threads of their own without a lock.
    """

    def __init__(
        self,
        models: Sequence[TextureModel],
        output: OutputGenerator,
        *,
        estimate_hz: float,
        output_hz: float,
        threads: bool,
        sink: Sink | None,
    ) -> None:
        self.output_hz = output_hz
        self.output = output
        self._models = tuple(models)
        self._touched: tuple[TextureModel, tuple[float, float, float]] | None = None
        self.newest: VibrationFilter | None = None
        """The newest estimate; None before the first touch, and while nothing is touched."""
        self._period = output_hz / estimate_hz  # in samples of the output
        self._given = 0
        self._due = 0.0
        self._ending = threading.Event()
        self._failure: Exception | None = None
        self._own_estimates = not threads
        self._threads: list[threading.Thread] = []
        if threads:
            self._start("estimate", 1.0 / estimate_hz, self.estimate)
        if sink is not None:
            block = max(1, round(_BLOCK_S * output_hz))
            self._start("generate", block / output_hz, lambda: sink(self.render(block)))

    def touch(self, texture: int | None, motion: tuple[float, float, float]) -> None:
        """Set the present motion of the hand; see `touch`."""
        count = len(self._models)
        if texture is not None and not 0 <= texture < count:
            raise InputError(f"texture {texture}: there are {count}, counted from 0")
        self._touched = None if texture is None else (self._models[texture], motion)

    def estimate(self) -> None:
        """Update `newest`; takes some 50 us with a triangulation."""
        touched = self._touched
        if touched is None:
            self.newest = None
            return
        model, motion = touched
        self.newest = estimate(model, *model.space.from_motion(*motion)[0])

    def render(self, count: int) -> FloatArray:
        """Return the next samples; see `render`."""
        blocks = []
        while count > 0:
            part = count
            if self._own_estimates:
                if self._given >= self._due:
                    self.estimate()
                    self._due += self._period
                part = min(count, math.ceil(self._due - self._given))
            self.output.set_estimate(self.newest)
            blocks.append(self.output.generate(part))
            self._given += part
            count -= part
        return np.concatenate(blocks) if blocks else np.zeros(0)

    @property
    def running(self) -> bool:
        """Whether the textures are not closed and no thread has failed."""
        return not self._ending.is_set()

    def check(self) -> None:
        """Raise `MmtError` if the textures are closed or a thread has failed."""
        if not self.running and self._failure is None:
            raise MmtError("these textures have been closed: open them again")
        if self._failure is not None:
            raise MmtError(f"rendering has ended: {self._failure}") from self._failure

    def close(self) -> None:
        """End the threads."""
        self._ending.set()
        for thread in self._threads:
            if thread is not threading.current_thread():
                thread.join(_JOIN_S)

    def _start(self, name: str, period_s: float, work: Callable[[], object]) -> None:
        thread = threading.Thread(
            target=self._run, args=(period_s, work), name=f"mmt-{name}", daemon=True
        )
        self._threads.append(thread)
        thread.start()

    def _run(self, period_s: float, work: Callable[[], object]) -> None:
        """Call `work` once a period, by deadlines that do not drift; late calls are caught up."""
        due_s = time.monotonic()
        try:
            while not self._ending.wait(max(0.0, due_s - time.monotonic())):
                work()
                due_s += period_s
        except Exception as error:  # noqa: BLE001 - raised by the next call
            self._failure = error
            self._ending.set()


def open_textures(
    sources: Sequence[Source],
    *,
    output_hz: float = 2000.0,
    estimate_hz: float = 100.0,
    seed: int = 0,
    limit_m_s2: float = 60.0,
    threads: bool = False,
    sink: Sink | None = None,
) -> Textures:
    """Load models, and prepare to render them; the first of four calls.

    Parameters
    ----------
    sources
        Model files, names of shipped models, or models, at least one; their order numbers
        them from 0.
    output_hz
        Rate of what `render` returns. A model is rendered at its own rate, and converted.
    estimate_hz
        Rate at which the filter follows the hand.
    seed
        Seed of the excitation. Without threads, the same seed and the same calls give the same
        samples, whatever the size of the blocks.
    limit_m_s2
        Bound of the vibration.
    threads
        Whether estimates are made in a thread of their own, by the clock, rather than in
        `render`, by the samples it gives.
    sink
        Called with samples in blocks of 5 ms, which a thread of its own generates by the clock;
        do not call `render` then. None for no such thread.

    Raises
    ------
    InputError
        A file is no model, a rate is not positive, or there is no source.
    """
    if not sources:
        raise InputError("no texture was given: at least one is needed")
    for name, value in (("output_hz", output_hz), ("estimate_hz", estimate_hz)):
        if not 0.0 < value < float("inf"):
            raise InputError(f"{name} is {value}: it must be positive and finite")
    models = [
        source if isinstance(source, TextureModel) else TextureModel.load(find_model(Path(source)))
        for source in sources
    ]
    output = OutputGenerator(
        (model.rate_hz for model in models), output_hz, seed=seed, limit_m_s2=limit_m_s2
    )
    return Textures(
        models,
        output,
        estimate_hz=estimate_hz,
        output_hz=output_hz,
        threads=threads,
        sink=sink,
    )


def touch(
    textures: Textures,
    texture: int | None,
    velocity_x_mm_s: float = 0.0,
    velocity_y_mm_s: float = 0.0,
    force_n: float = 0.0,
) -> None:
    """Set the hand's present motion; returns at once, from any thread.

    Parameters
    ----------
    textures
        Result of `open_textures`.
    texture
        Number of the texture that is touched, None for none.
    velocity_x_mm_s, velocity_y_mm_s
        Velocity of the tool over the surface. A model of speed takes its magnitude.
    force_n
        Along the surface's normal.

    Raises
    ------
    InputError
        There is no such texture.
    MmtError
        The textures are closed, or a thread has failed.
    """
    textures.check()
    textures.touch(texture, (velocity_x_mm_s, velocity_y_mm_s, force_n))


def render(textures: Textures, count: int) -> FloatArray:
    """Return the next samples of vibration in m/s2, shape (count,); from one thread at a time.

    Raises
    ------
    MmtError
        The textures are closed, or a thread has failed.
    """
    textures.check()
    return textures.render(count)


def close(textures: Textures) -> None:
    """End the threads, if there are any. Closed textures can only be closed again."""
    textures.close()
