"""Build the models of a recorded session as the live leader does, and keep every state."""

from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from annotated_types import Gt

from mmt.core.arrays import RecordArray
from mmt.core.bounds import check
from mmt.core.errors import InputError
from mmt.core.frames import check_frame_rate, check_frames, samples_per_frame
from mmt.core.output.plottable import Plottable
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.online.log import ModelLog
from mmt.texture.online.modeller import OnlineModeller
from mmt.texture.online.updates import ModelUpdate
from mmt.texture.segmentation.bottom_up import CELL
from mmt.texture.segmentation.segmenter import Segment
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.aligned import AlignedBlock
from mmt.texture.signals.filtering import StreamNumbering


@dataclass(frozen=True, repr=False)
class ModelHistory(Plottable):
    """A model as it grew over a session: every update, and when its criteria were met."""

    updates: tuple[ModelUpdate, ...]
    """In order, each with its session time ``time_s`` and its ``model``, which is None without
    samples. Each access may build the model anew: keep a model that is needed twice."""
    finished: tuple[Segment, ...]
    """The segments of the finished model: that at the stop criterion, or at the end of the
    session if the criterion was never met."""
    start_s: float | None
    """Session time at which the start criterion was met, None if it never was."""
    stop_s: float | None
    """Session time at which the stop criterion was met, None if it never was."""
    log: ModelLog
    """Log from which the models are built again, also without held-out segments."""

    def model_at(self, time_s: float | None) -> TextureModel | None:
        """Return the model as it was at a session time, or None before its first sample.

        The time may be None, as `start_s` may; the result is then None.
        """
        return None if time_s is None else self.model(self.number(time_s))

    def number(self, time_s: float) -> int:
        """Return the number of the last update up to a session time, -1 before the first."""
        return bisect_right(self.updates, time_s, key=lambda update: update.time_s) - 1

    def model(self, number: int) -> TextureModel | None:
        """Return the model after an update by its number, None before the first."""
        return self.updates[number].model if number >= 0 else None

    def __repr__(self) -> str:
        last = self.updates[-1] if self.updates else None
        samples = len(last.model.samples) if last is not None and last.model is not None else 0
        met = [
            f"{name} {'never' if at_s is None else f'at {at_s:.1f} s'}"
            for name, at_s in (("started", self.start_s), ("stopped", self.stop_s))
        ]
        end_s = 0.0 if last is None else last.time_s
        return (
            f"<ModelHistory: {len(self.updates)} updates to {end_s:.1f} s, "
            f"{samples} samples at the end, {', '.join(met)}>"
        )


def build_model(
    frames: RecordArray,
    settings: ModellingSettings | None = None,
    update_s: float = 1.0,
    *,
    on_progress: Callable[[float], None] | None = None,
) -> ModelHistory:
    """Build a session's model as the live leader does, to the end of the session.

    Parameters
    ----------
    frames
        Shape (n,), with position, force and acceleration, as `mmt.read_session` gives them.
    settings
        Settings of the modelling; None takes the defaults. The number of samples per frame is
        taken from the frames.
    update_s
        Session time between two updates of the model.
    on_progress
        Called after each update with the session time (s) that is modelled.

    Raises
    ------
    InputError
        There are no frames, a channel is missing, or a value is not allowed.

    Examples
    --------
    >>> import mmt
    >>> frames, truth = mmt.simulate_session(mmt.Scene(), surface="wood", duration_s=6.0)
    >>> history = mmt.build_model(frames)
    >>> len(history.updates)
    6
    >>> history.model_at(0.5) is None
    True
    """
    check("settings", settings, ModellingSettings | None)
    check_frames(frames)
    settings = settings or ModellingSettings()
    settings = replace(settings, samples_per_frame=samples_per_frame(frames.dtype))
    check("update_s", update_s, Annotated[float, Gt(0)])
    if len(frames) == 0:
        raise InputError("there are no frames, so no model can be built")
    period_frames = max(1, round(update_s * settings.rate_hz))
    blocks = stream_blocks([frames], period_frames)
    return build_together(blocks, [settings], on_progress=on_progress)[0]


def stream_blocks(parts: Iterable[RecordArray], period_frames: int) -> Iterator[RecordArray]:
    """Cut a session, in parts of shape (n,), into the blocks that a leader models at a time.

    A block is full when its newest sequence number is a period ahead of its first one; the
    rest at the end is a last, shorter block. The numbering continues if the frames' own numbers
    restart or wrap, see `mmt.texture.signals.filtering`.
    """
    frames: RecordArray | None = None
    highest, numbering = -1, StreamNumbering()
    for part in map(numbering.number, parts):
        frames = part if frames is None else np.concatenate([frames, part])
        newest = np.maximum.accumulate(frames["sequence"].astype(np.int64))
        start = 0
        while start < len(frames):
            due = int(frames["sequence"][start]) + period_frames - 1
            stop = start + 1
            if due > highest:
                stop = int(np.searchsorted(newest, due)) + 1
            if stop > len(frames):
                break
            yield frames[start : max(start + 1, stop)]
            start = max(start + 1, stop)
        highest = max(highest, int(newest[start - 1])) if start else highest
        frames = frames[start:]
    if frames is not None and len(frames):
        yield frames


def trials(sessions: Sequence[RecordArray]) -> list[RecordArray]:
    """Return the frames of several sessions as blocks of one session, a block for each.

    Their sequence numbers continue, with a gap in between: filters start again there, and no
    segment reaches from one session into the next. Each begins on the segmentation's grid, so
    that its segments do not depend on the sessions before it.
    """
    blocks, following = [], 0
    for frames in sessions:
        block = StreamNumbering().number(frames).copy()  # a wrap would leave no room behind it
        numbers = block["sequence"].astype(np.int64)
        block["sequence"] = numbers - int(numbers.min()) + following
        following = (int(block["sequence"].max()) + 1 + 2 * CELL) // CELL * CELL
        blocks.append(block)
    return blocks


def build(
    blocks: Iterable[RecordArray], settings: ModellingSettings, *, deferred: bool = True
) -> ModelHistory:
    """Build a model from blocks of frames, one update each, to the end of the session.

    Unlike the live leader, and like paper A's Table I, it continues after the stop criterion.

    Parameters
    ----------
    blocks
        At least one, of at least one frame each; see `stream_blocks`.
    settings
        How to model.
    deferred
        Whether models are built on access. False builds and keeps each in its update, so that an
        update takes as long as in the live leader.
    """
    return build_together(blocks, [settings], deferred=deferred)[0]


def build_together(
    blocks: Iterable[RecordArray],
    settings: Sequence[ModellingSettings],
    *,
    deferred: bool = True,
    observe: Callable[[AlignedBlock], None] | None = None,
    on_progress: Callable[[float], None] | None = None,
) -> list[ModelHistory]:
    """Build several models from the same segments, as `build` builds one.

    Parameters
    ----------
    blocks, deferred
        As of `build`.
    settings
        Settings of each model. Those of filters and segments must be the same.
    observe
        Called with each filtered block.
    on_progress
        As of `build_model`.

    Raises
    ------
    InputError
        The rate of the frames, by their time stamps, is not that of the settings.
    """
    modellers = [OnlineModeller(each, deferred=deferred) for each in settings]
    logs = [ModelLog(each) for each in settings]
    updates: list[list[ModelUpdate]] = [[] for _ in modellers]
    finished: list[tuple[Segment, ...]] = [() for _ in modellers]
    for block in blocks:
        check_frame_rate(block, modellers[0].settings.rate_hz)
        (segmented,) = modellers[0].segment(block)
        for place, modeller in enumerate(modellers):
            work = segmented.copy_for(modeller)
            modeller.fit(work)
            modeller.build(work)
            logged = logs[place].add(work)
            work.source = logged if deferred else work.source
            if not modeller.completion.stopped:  # until this update is judged
                finished[place] = tuple(fit.segment for fit in work.fits)
            updates[place].append(modeller.judge(work))
        if observe is not None:
            observe(segmented.observed[0])
        if on_progress is not None:
            on_progress(updates[0][-1].time_s)
    criteria = (modeller.completion for modeller in modellers)
    return [
        ModelHistory(tuple(made), segments, criterion.start_s, criterion.stop_s, log)
        for made, segments, criterion, log in zip(updates, finished, criteria, logs, strict=True)
    ]
