"""Sessions of textures, networks and seeds, and what each method let the hand feel in them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from types import MappingProxyType
from typing import Any, Final, TypeVar

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray
from mmt.scene import Network
from mmt.testing.simulation import RATE_HZ
from mmt.testing.simulation.textures import SURFACES
from mmt.texture.online.modeller import ModelUpdate
from mmt.texture.settings import ModellingSettings
from mmt_lab.felt.judging import Course, Reference
from mmt_lab.felt.leading import (
    at_once,
    led,
    local_updates,
    settings_over,
    taking_over,
)
from mmt_lab.felt.passing import pass_over
from mmt_lab.felt.warming import library_without, warm_models
from mmt_lab.methods.cases import DURATION_S, FIRST_SEED, GRAINED_DURATION_S
from mmt_lab.methods.judging import METHODS as METHODS_OF_MODELLING
from mmt_lab.sweep.running import in_order

NETWORKS: Final = ("lan", "wifi", "wan", "bad")

AT_ONCE: Final = "at once"
"""The bound: the surface under the hand itself."""

WARM: Final = "warm"
"""As ours, after a warm start from the shipped models but the texture's own."""

METHODS: Final[Mapping[str, Mapping[str, Any] | None]] = MappingProxyType(
    {
        "streaming": None,
        "published": METHODS_OF_MODELLING["published"],
        "ours": METHODS_OF_MODELLING["ours"],
        WARM: METHODS_OF_MODELLING["ours"],
    }
)
"""Keys of ``[texture]`` by the method's name; streaming has no model."""

SPANS_S: Final = ((0.0, 5.0), (5.0, 10.0), (10.0, 1000.0))
"""Session times over which errors are gathered."""


Default = TypeVar("Default")


@dataclass(frozen=True)
class Case:
    """One session: a texture, a network's profile, a seed."""

    texture: str
    network: str
    seed: int

    @property
    def duration_s(self) -> float:
        """As long as texture and hand need to come to the stop criterion."""
        return DURATION_S if SURFACES[self.texture].isotropic else GRAINED_DURATION_S


@dataclass(frozen=True)
class Outcome:
    """What one method let the hand feel in one session."""

    case: Case
    method: str
    start_s: float | None
    course: Course


@dataclass(frozen=True)
class Row:
    """One method over one network, all sessions together.

    Attributes
    ----------
    level_db, bands_db
        Root mean square over the moments of each of `SPANS_S`, then the median over sessions;
        None where no session has a moment there.
    onset_ms, offset_ms
        Medians over all strokes; None without any.
    start_s
        Median over the sessions in which a model took over.
    """

    network: str
    method: str
    sessions: int
    start_s: float | None
    level_db: tuple[float | None, ...]
    bands_db: tuple[float | None, ...]
    onset_ms: float | None
    offset_ms: float | None


def cases(seeds: int, textures: Sequence[str]) -> list[Case]:
    """Return so many sessions of each texture over each network."""
    return [
        Case(texture, network, FIRST_SEED + seed)
        for network in NETWORKS
        for texture in textures
        for seed in range(seeds)
    ]


def feel(case: Case) -> list[Outcome]:
    """Run one session, let each method lead it, and judge them."""
    surface = SURFACES[case.texture]
    ticks = round(case.duration_s * RATE_HZ)
    passage = pass_over(
        surface, Network.model_validate({"profile": case.network}), ticks, case.seed
    )
    bound = at_once(passage, case.seed)
    reference = Reference(passage, bound.vibration_m_s2)
    felt = {AT_ONCE: bound}
    updates: dict[ModellingSettings, dict[int, ModelUpdate]] = {}
    for name, keys in METHODS.items():
        models = None
        if keys is not None:
            settings = settings_over(passage, keys)
            if settings not in updates:
                updates[settings] = local_updates(passage, settings)
            models = taking_over(updates[settings])
            if name == WARM:
                library = library_without(case.texture)
                models |= warm_models(passage, updates[settings], library, settings)
        felt[name] = led(passage, models, case.seed)
    return [
        Outcome(case, name, own.start_s, reference.judge(own.vibration_m_s2))
        for name, own in felt.items()
    ]


def feel_all(
    chosen: Sequence[Case], workers: int, progress: Callable[[int], None] = lambda _done: None
) -> list[Outcome]:
    """Run sessions in processes of this machine, in their order.

    Raises
    ------
    MmtError
        A process has died.
    """
    outcomes = in_order(feel, [(case,) for case in chosen], workers, progress)
    return [one for felt in outcomes for one in felt]


def rows(outcomes: Sequence[Outcome]) -> list[Row]:
    """Gather outcomes by network and method."""
    return [
        _row(network, method, found)
        for network in NETWORKS
        for method in (*METHODS, AT_ONCE)
        if (found := _of(outcomes, network, method))
    ]


def by_second(outcomes: Sequence[Outcome], network: str, method: str) -> FloatArray:
    """Return the level's error in each second of session time, shape (s,), dB rms.

    The median over sessions; NaN where no session has a moment.
    """
    found = _of(outcomes, network, method)
    last = max(int(one.course.time_s[-1]) for one in found)
    seconds = [
        [_rms(one.course.level_db, _within(one.course, at, at + 1.0)) for one in found]
        for at in range(last + 1)
    ]
    return np.array([_median(values, np.nan) for values in seconds])


def as_dict(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Return everything for a program."""
    curves = {
        network: {
            method: [
                None if np.isnan(v) else float(v) for v in by_second(outcomes, network, method)
            ]
            for method in (*METHODS, AT_ONCE)
            if _of(outcomes, network, method)
        }
        for network in NETWORKS
    }
    return {"rows": [asdict(row) for row in rows(outcomes)], "level_db_by_second": curves}


def _of(outcomes: Sequence[Outcome], network: str, method: str) -> list[Outcome]:
    return [one for one in outcomes if one.case.network == network and one.method == method]


def _row(network: str, method: str, found: Sequence[Outcome]) -> Row:
    courses = [one.course for one in found]
    levels, bands = (
        tuple(
            _median([_rms(getattr(c, name), _within(c, *span)) for c in courses], None)
            for span in SPANS_S
        )
        for name in ("level_db", "bands_db")
    )
    return Row(
        network=network,
        method=method,
        sessions=len(found),
        start_s=_median([one.start_s for one in found], None),
        level_db=levels,
        bands_db=bands,
        onset_ms=_median(np.concatenate([c.onset_ms for c in courses]).tolist(), None),
        offset_ms=_median(np.concatenate([c.offset_ms for c in courses]).tolist(), None),
    )


def _within(course: Course, first_s: float, stop_s: float) -> BoolArray:
    return np.asarray((course.time_s >= first_s) & (course.time_s < stop_s))


def _rms(errors_db: FloatArray, chosen: BoolArray) -> float | None:
    return float(np.sqrt(np.mean(np.square(errors_db[chosen])))) if chosen.any() else None


def _median(values: Sequence[float | None], default: Default) -> float | Default:
    present = [value for value in values if value is not None]
    return float(np.median(present)) if present else default
