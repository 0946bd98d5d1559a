"""Vibration that the operator feels over a network, against the surface's own without one.

A hand strokes a known texture over an emulated network, in simulated time. Each method renders the
same session: the stream alone, paper A's model, and the field. The vibration at the hand is
compared, moment by moment, with the exact powers of the texture at the hand's own speed, force and
heading. The bound is a realisation of the texture directly under the hand.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure

from mmt.core.arrays import FloatArray
from mmt.core.output.palette import SERIES
from mmt.devices.haptuator.options import DATA_SHEET_LOW_HZ
from mmt.evaluation.model_errors import root_mean_square
from mmt.evaluation.reports.document import ReportTable
from mmt.evaluation.reports.figures import style_axes
from mmt.evaluation.reports.report_files import picture
from mmt.evaluation.run_verdict import median_of_known
from mmt.evaluation.texts import number
from mmt.scene import PROFILES, Network
from mmt.testing.simulation import RATE_HZ
from mmt.testing.simulation.surfaces.textures import get_surface
from mmt_lab.compare.cases import DURATION_S, FIRST_SEED
from mmt_lab.compare.judging import METHODS as METHODS_OF_MODELLING
from mmt_lab.felt.judging import HOP, LEAST_RMS_M_S2, WINDOW, FeltErrors, Reference
from mmt_lab.felt.passing import (
    leader_vibration,
    local_models,
    stroke_over_network,
    undelayed_vibration,
)
from mmt_lab.harness.experiment import HandKind, Seeds, Textures, Workers, chosen_textures, hand_of
from mmt_lab.harness.findings import Findings
from mmt_lab.harness.processes import map_in_processes

SHOWS: Final = "how far what the hand feels over a network is from the surface itself, by method"
TAKES: Final = "1 h on 2 processors"

NETWORKS: Final = ("lan", "wifi", "wan", "bad")

AT_ONCE: Final = "at once"
"""Name of the bound: the surface directly under the hand."""

METHODS: Final[Mapping[str, Mapping[str, Any] | None]] = MappingProxyType(
    {
        "streaming": None,
        "published": METHODS_OF_MODELLING["published"],
        "field": METHODS_OF_MODELLING["field"],
    }
)
"""Keys of ``[texture]`` by the method's name; streaming has no model."""

SHOWN: Final = (*METHODS, AT_ONCE)

SPANS_S: Final = ((0.0, 5.0), (5.0, 10.0), (10.0, 1000.0))
"""Spans of session time over which errors are pooled."""

_ERRORS: Final = ("level_db", "bands_db", "skin_db")


@dataclass(frozen=True)
class TrialResult:
    """Errors of one method in one session, and the time when its model took over."""

    network: str
    method: str
    start_s: float | None
    course: FeltErrors


def run_trial(texture: str, network: str, seed: int, hand: str = "strokes") -> list[TrialResult]:
    """Run one session over a profile's network, render it by each method, and judge the results."""
    surface = get_surface(texture)
    emulated = Network.model_validate({"profile": network})
    stroking = hand_of(hand, isotropic=surface.isotropic)
    ticks = round(DURATION_S * RATE_HZ)
    passage = stroke_over_network(surface, emulated, ticks, seed, stroking)
    bound_m_s2 = undelayed_vibration(passage, seed)
    reference = Reference(passage, bound_m_s2)
    results = [TrialResult(network, AT_ONCE, 0.0, reference.judge(bound_m_s2))]
    for name, keys in METHODS.items():
        models = None if keys is None else local_models(passage, keys)
        felt_m_s2, start_s = leader_vibration(passage, models, seed)
        results.append(TrialResult(network, name, start_s, reference.judge(felt_m_s2)))
    return results


def rows(outcomes: Sequence[TrialResult]) -> list[dict[str, Any]]:
    """Return the figures of each method over each network, all sessions together.

    ``level_db``, ``bands_db`` and ``skin_db`` are root mean squares over the moments of each of
    `SPANS_S`, then medians over sessions, None if no session has a moment in the span.
    ``onset_ms`` and ``offset_ms`` are medians over all strokes, ``start_s`` over the sessions
    with a model.
    """
    return [
        {
            "network": network,
            "method": method,
            "sessions": len(found),
            "start_s": median_of_known([one.start_s for one in found]),
            **{name: _medians(courses, name, SPANS_S) for name in _ERRORS},
            "onset_ms": median_of_known(np.concatenate([c.onset_ms for c in courses]).tolist()),
            "offset_ms": median_of_known(np.concatenate([c.offset_ms for c in courses]).tolist()),
        }
        for network in NETWORKS
        for method in SHOWN
        if (found := _of(outcomes, network, method))
        for courses in [[one.course for one in found]]
    ]


def by_second(outcomes: Sequence[TrialResult], network: str, method: str) -> FloatArray:
    """Return the level's error in each second of session time, shape (s,), dB rms.

    It is the median over sessions; NaN if no session has a moment in that second.
    """
    courses = [one.course for one in _of(outcomes, network, method)]
    last = max((int(at_s) for each in courses for at_s in each.time_s[-1:]), default=-1)
    medians = _medians(courses, "level_db", [(at, at + 1.0) for at in range(last + 1)])
    return np.array(medians, dtype=np.float64)


def _of(outcomes: Sequence[TrialResult], network: str, method: str) -> list[TrialResult]:
    return [one for one in outcomes if (one.network, one.method) == (network, method)]


def _medians(
    courses: Sequence[FeltErrors], name: str, spans_s: Sequence[tuple[float, float]]
) -> list[float | None]:
    """Return the median of the sessions' errors of a name in each span of session time."""
    return [median_of_known(_rms(each, name, *span_s) for each in courses) for span_s in spans_s]


def _rms(course: FeltErrors, name: str, first_s: float, stop_s: float) -> float | None:
    chosen = (course.time_s >= first_s) & (course.time_s < stop_s)
    return root_mean_square(getattr(course, name)[chosen]) if chosen.any() else None


DEFINITIONS: Final = {
    "compared with": "what the surface would give at the hand's own speed, force and heading at "
    "that moment, without a network: exact powers of the known texture",
    "moment": f"{WINDOW} samples under a Hann window, every {HOP} ms, where the hand is to feel "
    f"something or does: more than {LEAST_RMS_M_S2:g} m/s2 rms; less counts as so much",
    "level": "error of the power between 10 and 500 Hz, dB; rms over the moments of a span of "
    "session time, median over sessions",
    "bands": "the same over nine bands of that range and all moments",
    "skin": f"the level behind a Haptuator that is driven from {DATA_SHEET_LOW_HZ:g} Hz on, as its "
    "data sheet says, and even there",
    "onset, offset": "how much later than without a network vibration begins after a rest and "
    "ends before one, medians over strokes, ms",
    AT_ONCE: "a realisation of the texture itself under the hand: what is left is the scatter of "
    "a moment",
    "streaming": "the stream through the playout buffer, without a model",
    "published": "paper A: streamed until the start criterion, then rendered; the excitation's "
    "variance interpolated, on textures with a grain by paper B's network",
    "field": "the same with the default of [texture]",
}


def felt_table(outcomes: Sequence[TrialResult]) -> ReportTable:
    """Return a row for each network and method."""
    spans = [f"{a:g}-{b:g} s" if b < 100 else f"from {a:g} s" for a, b in SPANS_S]
    columns = ["network", "method", *(f"level {span}" for span in spans)]
    columns += [f"bands {span}" for span in spans] + [f"skin {spans[-1]}"]
    columns += ["onset (ms)", "offset (ms)"]
    body = [
        [
            *(row["network"], row["method"]),
            *(number(value, 2) for value in (*row["level_db"], *row["bands_db"])),
            number(row["skin_db"][-1], 2),
            *(number(row[key], 0) for key in ("onset_ms", "offset_ms")),
        ]
        for row in rows(outcomes)
    ]
    return ReportTable(columns, body, "Errors in dB of what the hand feels, by session time.")


def felt_figure(curves: Mapping[str, Mapping[str, FloatArray]]) -> Figure:
    """Draw the level's error in each second by network and method, a panel for each network."""
    shown = [network for network, errors in curves.items() if errors]
    figure = Figure(figsize=(2.55 * len(shown) + 0.6, 3.2), layout="constrained")
    panels = figure.subplots(1, len(shown), sharey=True, squeeze=False)[0]
    for axis, network in zip(panels, shown, strict=True):
        for method, error_db in curves[network].items():
            axis.plot(
                np.arange(len(error_db)) + 0.5,
                error_db,
                color=SERIES[SHOWN.index(method)],
                linestyle=":" if method == AT_ONCE else "-",
                linewidth=1.6,
                label=method,
            )
        axis.set_title(f"{network}: {_delay(network)}", fontsize=9)
        axis.set_xlabel("session time (s)")
        axis.set_xlim(left=0.0)
        style_axes(axis)
    panels[0].set_yscale("log", base=2)
    panels[0].yaxis.set_major_formatter("{x:g}")
    panels[0].set_ylabel("error of what is felt (dB rms)")
    panels[0].legend(frameon=False, fontsize=8)
    return figure


def _delay(network: str) -> str:
    """Return a network's delay and loss in words."""
    emulated = Network.model_validate({"profile": network})
    words = f"{emulated.delay_ms:g} ± {emulated.jitter_ms:g} ms each way"
    return f"{words}, {100 * emulated.loss:g} % lost" if emulated.loss else words


def run(
    seeds: Seeds = 3,
    textures: Textures = None,
    hand: HandKind = "strokes",
    workers: Workers = None,
) -> Findings:
    """Measure what the hand feels over each network, by method."""
    kind = hand_of(hand).kind
    calls = [
        (texture, network, FIRST_SEED + seed, kind)
        for network in NETWORKS
        for texture in chosen_textures(textures)
        for seed in range(seeds)
    ]
    outcomes = [
        one
        for felt in map_in_processes(run_trial, calls, workers=workers, what="stroking")
        for one in felt
    ]
    table = felt_table(outcomes)
    curves = {
        network: {
            method: by_second(outcomes, network, method)
            for method in SHOWN
            if _of(outcomes, network, method)
        }
        for network in NETWORKS
    }
    return Findings(
        "What the operator feels, end to end",
        "At each moment: vibration at the leader against what the surface would give.",
        tables=[table],
        blocks=lambda: [
            picture("felt", "Level of what is felt, by session time.", felt_figure(curves)),
            table,
        ],
        definitions=DEFINITIONS,
        settings=[ReportTable(("network", "each way"), [(n, str(PROFILES[n])) for n in NETWORKS])],
        data={"rows": rows(outcomes), "level_db_by_second": curves},
    )
