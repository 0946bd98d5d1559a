"""Vibration by another method's generator, which renders in a process of its own.

The generator may take any time, so the tick never waits for it. The hand's motion is sent in blocks
of 10 ms, and the vibration of a block is played 20 ms after the motion: 10 ms to gather the block,
and 10 ms to render it. A late block is left out and counted: the last block before it fades out,
reversed in time, and the next one fades in.
"""

from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.running.ticking import TimeHistogram
from mmt.leader.output.renderer import Renderer, crossfaded

BLOCK_MS: Final = 10
"""Length of a block, which is also its number of frames."""

_MOST_UNDER_WAY: Final = 3
"""Most blocks without an answer; no more are sent, so that sending never blocks."""

_WINDOW: Final = 200
"""Blocks in a window; if half of them are late, the generator is too slow."""


class RenderedBlock(NamedTuple):
    """A block from the process that renders.

    ``epoch`` counts resets of our model since the session began, and ``build`` fits since then,
    0 before the first. ``clipped`` counts clipped samples so far; ``samples`` are the bytes of the
    block's samples, float64.
    """

    number: int
    epoch: int
    build: int
    elapsed_ns: int
    clipped: int
    samples: bytes


class GeneratedVibration:
    """Render from the generator if that is wanted and ready, else from our model.

    Parameters
    ----------
    name
        Name of the generator in messages.
    model
        Renders from our model.
    crossfade_samples
        Length of the fade between the two; 0 switches at once.
    samples_per_frame
        Samples of vibration in a frame, which is a millisecond.

    Attributes
    ----------
    channel
        Channel to the process that renders, None before it runs. It is sent the number of each
        block and the bytes of its motion, shape (3, n), and answers with a `RenderedBlock`, or with
        a sentence that says why no more blocks follow.
    wanted
        Whether the generator is to be rendered.
    epoch
        Number of resets of our model; generators of an earlier epoch are not rendered.
    fault
        Why the generator has failed, None as long as it has not.
    late, blocks, clipped
        Number of late blocks, of blocks asked of a generator, and of clipped samples.
    times
        Times that the blocks took to render, in their process.
    """

    directed = True

    def __init__(
        self, name: str, model: Renderer, crossfade_samples: int, samples_per_frame: int
    ) -> None:
        self._name, self._model = name, model
        self._step = 1.0 / crossfade_samples if crossfade_samples > 0 else 1.0
        self._share = 0.0
        block = BLOCK_MS * samples_per_frame
        self._fade_in = np.arange(1, block + 1) / block
        self._motion, self._playing = np.zeros((3, block)), np.zeros(block)
        self._sounds = False  # whether a rendered block is played
        self._at = self._number = self._under_way = self._window = self._late_in_window = 0
        self._newest: tuple[int, int] = (0, 0)  # epoch and fit of the newest block
        self.channel: Connection | None = None
        self.wanted = False
        self.epoch = self.late = self.blocks = self.clipped = 0
        self.fault: str | None = None
        self.times = TimeHistogram()

    @property
    def ready(self) -> bool:
        """Whether a generator of the present epoch renders."""
        epoch, build = self._newest
        return self.fault is None and epoch == self.epoch and build > 0

    @property
    def is_rendered(self) -> bool:
        """Whether the generator is rendered, and not our model."""
        return self.wanted and self.ready

    def render(self, *motion: FloatArray) -> FloatArray:
        """Return the next n samples in m/s2.

        Parameters
        ----------
        *motion
            Velocity x, y (mm/s) and normal force (N), each of shape (n,).
        """
        generated = self.follow(*motion)
        goal = 1.0 if self.is_rendered else 0.0
        if self._share == goal == 1.0:
            return generated
        x_mm_s, y_mm_s, force_n = motion
        inputs = motion if self._model.directed else (np.hypot(x_mm_s, y_mm_s), force_n)
        ours = self._model.render(*inputs)
        if self._share == goal:
            return ours
        steps = self._step * np.arange(1, len(ours) + 1)
        share = np.clip(self._share + (steps if goal else -steps), 0.0, 1.0)
        self._share = float(share[-1])
        return crossfaded(share, ours, generated)

    def follow(self, *motion: FloatArray) -> FloatArray:
        """Return the generator's next n samples; call it even if they are not rendered."""
        output = np.empty(len(motion[0]))
        for index in range(len(output)):
            for row, values in zip(self._motion, motion, strict=True):
                row[self._at] = values[index]
            output[index] = self._playing[self._at]
            self._at += 1
            if self._at == len(self._playing):
                self._at = 0
                self._exchange()
        return output

    def _exchange(self) -> None:
        """Take the answer to the block before, and send the block that is full now."""
        channel = self.channel
        if channel is None or self.fault is not None:
            self._play(None)
            return
        arrived = None
        try:
            while channel.poll():
                block: RenderedBlock | str = channel.recv()
                if isinstance(block, str):
                    self.fault = block
                    break
                self._note(block)
                if block.number == self._number:
                    arrived = np.frombuffer(block.samples)
            self._number += 1
            if self.fault is None and self._under_way < _MOST_UNDER_WAY:
                with suppress(OSError):  # it has ended; what it said last is read after this block
                    channel.send((self._number, self._motion.tobytes()))
                    self._under_way += 1
        except (OSError, EOFError):
            self.fault = f"generator {self._name}: the process that renders has ended"
        if self.ready:
            self._count(late=arrived is None)
        self._play(arrived)

    def _note(self, block: RenderedBlock) -> None:
        self._under_way -= 1
        self._newest = block.epoch, block.build
        self.clipped = block.clipped
        if block.build:
            self.times.add(block.elapsed_ns)

    def _count(self, *, late: bool) -> None:
        self.blocks += 1
        self.late += late
        self._late_in_window += late
        self._window += 1
        if self._late_in_window >= _WINDOW // 2:
            self.fault = (
                f"generator {self._name}: too slow, {self._late_in_window} of {self._window} "
                f"blocks of {BLOCK_MS} ms were late"
            )
        if self._window == _WINDOW:
            self._window = self._late_in_window = 0

    def _play(self, block: FloatArray | None) -> None:
        """Play a block next; if there is none, fade the last one out in reversed time."""
        if block is not None:
            self._playing = block if self._sounds else block * self._fade_in
        elif self._sounds:
            self._playing = self._playing[::-1] * self._fade_in[::-1]
        else:
            self._playing = np.zeros(len(self._playing))
        self._sounds = block is not None
