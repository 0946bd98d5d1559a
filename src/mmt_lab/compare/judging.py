"""Judge methods on one session: build the model by each, compare it with the known texture."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError
from mmt.evaluation.grid_errors import GridErrors
from mmt.evaluation.levels import root_mean_square
from mmt.evaluation.truth import KnownTexture
from mmt.testing.simulation.textures import get_surface
from mmt.texture.online.history import ModelHistory, build, update_blocks
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.metrics import within_jnd
from mmt_lab.compare.cases import Case

METHODS: Final[Mapping[str, Mapping[str, Any]]] = MappingProxyType(
    {
        "published": {"method": "published"},
        "field": {"method": "field"},
    }
)
"""Keys of ``[texture]``, by the method's name: paper A's triangulation over speed and force, and
paper B's network where the heading counts; and the default. Both are compared at the moments of one
criterion."""

MOMENTS: Final = ("3 s", "start", "stop", "30 s")
"""When methods are compared. The criterion is that of the first method named."""

FIGURES: Final = (
    "within_jnd",
    "power_error_db",
    "gfc",
    "log_spectral_db",
    "band_error_db",
)
"""What is compared; the first and the third are better where larger."""

LARGER_IS_BETTER: Final = frozenset({"within_jnd", "gfc"})

PERIOD_S: Final = 1.0


@dataclass(frozen=True)
class Judged:
    """One method at one moment of one session.

    Attributes
    ----------
    group, name, texture, seed
        As in the `Case`.
    method, moment
        One each of `METHODS` and `MOMENTS`.
    time_s, samples
        Session time, and samples of the model.
    figures
        By `FIGURES`, over the grid of `mmt.evaluation.grid_errors`.
    bands_db
        Root mean square error of the power in each of nine bands, shape (9,).
    """

    group: str
    name: str
    texture: str
    seed: int
    method: str
    moment: str
    time_s: float
    samples: int
    figures: dict[str, float]
    bands_db: tuple[float, ...]


def check_methods(names: Sequence[str]) -> None:
    """Raise `InputError` where a method is not known, or named twice, or there are not two."""
    unknown = [name for name in names if name not in METHODS]
    if unknown or len(set(names)) != len(names) or len(names) < 2:
        raise InputError(
            f"--methods {','.join(names)}: name two or more of {', '.join(METHODS)}, each once"
        )


def blocks_of(case: Case) -> list[RecordArray]:
    """Simulate a session; return its frames, one block for each update."""
    return list(update_blocks(case.session(), round(PERIOD_S * 1000.0)))


def judge(case: Case, methods: Sequence[str], blocks: Sequence[RecordArray]) -> list[Judged]:
    """Build the models of one session by each method, and compare them with the texture.

    Costs a pass of modelling for each method.

    Parameters
    ----------
    case
        The session.
    methods
        Names in `METHODS`; the first one's criteria are the moments.
    blocks
        What `blocks_of` returns.
    """
    truth = KnownTexture(get_surface(case.texture))
    judged: list[Judged] = []
    times: dict[str, float] = {}
    for number, method in enumerate(methods):
        history = build(blocks, ModellingSettings(inputs=case.inputs, **METHODS[method]))
        if number == 0:
            times = moments_of(history)
        for moment, time_s in times.items():
            update = history.number(time_s)
            model = history.model(update)
            if model is None:
                continue
            errors = truth.compare(model)
            judged.append(
                Judged(
                    **case.labels,
                    method=method,
                    moment=moment,
                    time_s=time_s,
                    samples=len(model.samples),
                    figures=figures_of(errors),
                    bands_db=tuple(np.sqrt(np.mean(np.square(errors.bands_db), axis=0)).tolist()),
                )
            )
    return judged


def moments_of(history: ModelHistory) -> dict[str, float]:
    """Return the session time of each of `MOMENTS` that a session came to."""
    times = {"3 s": 3.0, "start": history.start_s, "stop": history.stop_s, "30 s": 30.0}
    end_s = history.updates[-1].time_s
    return {name: at for name, at in times.items() if at is not None and at <= end_s}


def figures_of(errors: GridErrors) -> dict[str, float]:
    """Return `FIGURES` of errors over strokes."""
    values = (
        within_jnd(errors.power_error_db),
        root_mean_square(errors.power_error_db),
        float(errors.gfc.mean()),
        float(errors.log_spectral_db.mean()),
        root_mean_square(errors.bands_db),
    )
    return dict(zip(FIGURES, values, strict=True))
