"""Judge others' generators beside our models: one session, everything by what it renders."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray, RecordArray
from mmt.evaluation.strokes_made import StrokesMade
from mmt.evaluation.truth import KnownTexture
from mmt.testing.simulation.textures import get_surface
from mmt.texture.generators.building import GeneratorModeller
from mmt.texture.generators.guarded import GeneratorFault, GuardedGenerator
from mmt.texture.generators.registry import load
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.online.history import build
from mmt.texture.synthesis.synthesizer import Synthesizer
from mmt_lab.compare.block_times import block_times_us, last_motion
from mmt_lab.compare.cases import Case
from mmt_lab.compare.judging import PERIOD_S, TIMES_S, Judged, blocks_of, figures_of, settings_of
from mmt_lab.compare.rendered_spectra import (
    RUN_S,
    STROKES,
    expected_spectra,
    render_strokes,
    rendered_errors,
    spectra_of,
)
from mmt_lab.compare.time_limit import time_limit

NUMBERS: Final = {round(time_s / PERIOD_S) - 1: time_s for time_s in TIMES_S}
"""Times at which is judged, by the number of the update that ends then."""

LONGEST_UPDATE_S: Final = 60.0
"""An update that takes longer ends the session for its generator."""


@dataclass(frozen=True)
class Rendered:
    """A method or generator at one time of one session, by what it renders.

    Attributes
    ----------
    judged
        As of a method, but by estimated spectra, at `STROKES` of the strokes that were made, and
        without the figures over the plane; ``samples`` are a generator's segments.
    exact
        The figures of a model's own spectra at the same strokes, None for a generator.
    scatter_db
        Scatter of the estimate of a level, root mean square over the strokes.
    clipped
        Share of the samples that were beyond the actuator's limit.
    """

    judged: Judged
    exact: dict[str, float] | None
    scatter_db: float
    clipped: float


@dataclass(frozen=True)
class Times:
    """What a method or generator took in one session.

    ``block_p50_us`` and ``block_p99_us`` are of blocks of 10 ms along the last strokes, in turns
    with all others; ``update_ms`` and ``longest_update_ms`` the median and the longest update.
    """

    group: str
    name: str
    texture: str
    seed: int
    method: str
    block_p50_us: float
    block_p99_us: float
    update_ms: float
    longest_update_ms: float


@dataclass(frozen=True)
class Fault:
    """Why a generator was not judged to the end of a session."""

    generator: str
    name: str
    texture: str
    seed: int
    reason: str


@dataclass(frozen=True)
class RenderedSession:
    """What came of one session."""

    rendered: tuple[Rendered, ...]
    times: tuple[Times, ...]
    faults: tuple[Fault, ...]


class ModelGenerator:
    """A texture model as a generator: the synthesizer of the leader.

    Parameters
    ----------
    model
        The model.
    """

    def __init__(self, model: TextureModel) -> None:
        self._model = model
        self.directed = model.space.directed
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Begin anew."""
        self._synthesizer = Synthesizer(self._model, seed=seed, limit_m_s2=np.inf)

    def generate(self, *inputs: FloatArray) -> FloatArray:
        """Return the next block."""
        return self._synthesizer.render(*inputs)


def judge_rendered(
    case: Case, methods: Sequence[str], generators: Sequence[str], run_s: float = RUN_S
) -> RenderedSession:
    """Judge methods and generators on one session by what they render.

    Parameters
    ----------
    case
        The session.
    methods
        Names as `mmt_lab.compare.judging.check_methods` allows them.
    generators
        Names that `mmt.texture.generators.registry.load` knows.
    run_s
        Length of each of two runs at a stroke.

    Raises
    ------
    InputError
        There is no such generator.
    """
    builders = {name: load(name) for name in generators}
    session = _Session(case, blocks_of(case.session()), run_s)
    for method in methods:
        session.judge_method(method)
    for name, builder in builders.items():
        modeller = GeneratorModeller(name, builder, settings_of(case, "field"))
        session.judge_generator(name, modeller)
    return session.outcome()


@dataclass
class _Session:
    """One session, and what is found on the way."""

    case: Case
    blocks: Sequence[RecordArray]
    run_s: float
    rendered: list[Rendered] = field(default_factory=list)
    faults: list[Fault] = field(default_factory=list)
    last: dict[str, GuardedGenerator] = field(default_factory=dict)
    updates_s: dict[str, list[float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        made = StrokesMade(settings_of(self.case, "field"))
        for block in self.blocks:
            made.add(block)
        truth = KnownTexture(get_surface(self.case.texture))
        self._strokes = made.strokes(STROKES)
        self._truth = truth.at(self._strokes)
        self._expected = expected_spectra(truth, self._strokes)

    def judge_method(self, method: str) -> None:
        """Judge a method of ours at every time."""
        history = build(self.blocks, settings_of(self.case, method), deferred=False)
        self.updates_s[method] = [sum(one.durations_s.values()) for one in history.updates]
        for number in NUMBERS:
            model = history.model(number)
            if model is not None:
                exact = figures_of(self._truth.errors(model))
                source = GuardedGenerator(method, ModelGenerator(model))
                self._judge(method, number, source, len(model.samples), exact)
        model = history.updates[-1].model
        if model is not None:
            self.last[method] = GuardedGenerator(method, ModelGenerator(model))

    def judge_generator(self, name: str, modeller: GeneratorModeller) -> None:
        """Judge a generator at every time, as it is then; a fault ends that."""
        try:
            for number, block in enumerate(self.blocks):
                late = f"generator {name}: an update took longer than {LONGEST_UPDATE_S:g} s"
                started = perf_counter()
                with time_limit(LONGEST_UPDATE_S, late):
                    source = modeller.update(block)
                self.updates_s.setdefault(name, []).append(perf_counter() - started)
                if number in NUMBERS and source is not None:
                    self._judge(name, number, source, modeller.segments, None)
        except GeneratorFault as fault:
            self._failed(name, fault)
            return
        if modeller.generator is not None:
            self.last[name] = modeller.generator
        else:
            self._failed(name, f"generator {name}: the builder returned None for the whole session")

    def outcome(self) -> RenderedSession:
        """Time the last of each, and return everything."""
        motion = last_motion(self.blocks, settings_of(self.case, "field"))
        blocks_us, faults = block_times_us(self.last, motion, self.case.seed)
        for name, fault in faults.items():
            self._failed(name, fault)
        times = [self._times(name, each_us) for name, each_us in blocks_us.items()]
        return RenderedSession(tuple(self.rendered), tuple(times), tuple(self.faults))

    def _times(self, name: str, blocks_us: FloatArray) -> Times:
        p50_us, p99_us = np.percentile(blocks_us, (50.0, 99.0)).tolist()
        updates_ms = [1e3 * each for each in self.updates_s[name]]
        return Times(
            **self.case.labels,
            method=name,
            block_p50_us=p50_us,
            block_p99_us=p99_us,
            update_ms=float(np.median(updates_ms)),
            longest_update_ms=max(updates_ms),
        )

    def _judge(
        self,
        method: str,
        number: int,
        source: GuardedGenerator,
        samples: int,
        exact: dict[str, float] | None,
    ) -> None:
        """Judge what is rendered after an update."""
        before = source.samples, source.clipped
        vibration = render_strokes(source, self._strokes, self.case.seed, self.run_s)
        clipped = (source.clipped - before[1]) / (source.samples - before[0])
        errors = rendered_errors(spectra_of(vibration), self._expected)
        judged = Judged(
            **self.case.labels,
            spoil="",
            method=method,
            moment=f"{NUMBERS[number]:g} s",
            time_s=NUMBERS[number],
            samples=samples,
            figures=errors.figures,
        )
        self.rendered.append(Rendered(judged, exact, errors.scatter_db, clipped))

    def _failed(self, name: str, reason: object) -> None:
        case = self.case
        self.faults.append(Fault(name, case.name, case.texture, case.seed, str(reason)))
