"""A session modelled by both methods, which an evaluation scores."""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError
from mmt.evaluation.strokes_made import StrokesMade
from mmt.evaluation.truth import KnownTexture, known_texture
from mmt.session.data import RecordedSession, missing_frames
from mmt.session.stream import Recording, blocks_of
from mmt.texture.online.history import ModelHistory, build, build_together, stream_blocks
from mmt.texture.settings import THRESHOLDS, Inputs, Method, ModellingSettings


class ModelledSession:
    """A session that was modelled by both methods, and what its frames say of it.

    Parameters and errors are those of `mmt.evaluation.evaluate.evaluate_session`. ``leader`` and
    ``other`` hold every state of the leader's model and of that of the other method, ``beside``.
    ``of_other_inputs`` is the model of the other inputs, None unless the known texture depends on
    the heading.
    """

    def __init__(
        self,
        session: Recording,
        settings: ModellingSettings,
        period_s: float,
        on_progress: Callable[[float], None] | None,
    ) -> None:
        self.started = time.perf_counter()
        self.session, self.settings, self.period_s = session, settings, period_s
        self.truth, self.basis_reason = known_texture(session.annotations, settings)
        self.beside, other_method = _method_to_compare(settings)
        self.made = StrokesMade(settings)
        self.first = self._highest = -1
        self.missing = 0
        self._last: RecordArray | None = None
        self.leader, self.other = build_together(
            map(self._count, self._blocks()),
            [settings, other_method],
            observe=self.made.add,
            on_progress=on_progress,
        )
        if not self.leader.updates:
            raise InputError(
                f"session {session.path}: it holds no frames, nothing can be evaluated"
            )
        self.duration_s = (self._highest + 1 - self.first) / settings.rate_hz
        self.final_s = self.duration_s if self.leader.stop_s is None else self.leader.stop_s
        self.of_other_inputs = _of_other_inputs(self._blocks(), settings, self.truth)

    @property
    def control_events(self) -> Sequence[Mapping[str, Any]]:
        """The events, if control may have changed hands: a file is read again for them."""
        session = self.session
        known = isinstance(session, RecordedSession) or "control" in (session.scene or {})
        return session.events if known else ()

    def _blocks(self) -> Iterator[RecordArray]:
        period_frames = max(1, round(self.period_s * self.settings.rate_hz))
        return stream_blocks(blocks_of(self.session), period_frames)

    def _count(self, block: RecordArray) -> RecordArray:
        """Count the next frames (n,), n > 0, and return them."""
        if self._last is None:
            self.first = int(block["sequence"][0])
        joined = block if self._last is None else np.concatenate([self._last, block])
        self.missing += missing_frames(joined)
        self._highest = max(self._highest, int(block["sequence"].max()))
        self._last = block[-1:]
        return block


def _of_other_inputs(
    blocks: Iterable[RecordArray], settings: ModellingSettings, truth: KnownTexture | None
) -> ModelHistory | None:
    """Build the model of the other inputs; None if the texture does not depend on the heading."""
    if truth is None or truth.surface.isotropic:
        return None
    inputs: Inputs = "isotropic" if settings.inputs == "anisotropic" else "anisotropic"
    others = replace(settings, inputs=inputs, start_distance="auto", stop_distance="auto")
    return build(blocks, others)


def _method_to_compare(settings: ModellingSettings) -> tuple[str, ModellingSettings]:
    """Return the name of the method that settings do not name, and its settings for the data."""
    other: Method = "field" if settings.method == "published" else "published"
    auto: dict[str, Any] = dict.fromkeys(THRESHOLDS[settings.method], "auto")
    return other, replace(settings, method=other, surfaces=None, **auto)
