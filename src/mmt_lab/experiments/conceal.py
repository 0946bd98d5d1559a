"""Concealment: what is felt around a gap in streamed vibration, by its length."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray, IntArray
from mmt.evaluation.levels import root_mean_square
from mmt.leader.output.concealment import Concealment, Continuation, FadeOut, backwards, modelled
from mmt.leader.output.playout import PlayoutBuffer
from mmt.leader.output.stream import StreamedVibration
from mmt.texture.signals.amplitude_spectra import amplitude_spectra
from mmt.texture.signals.metrics import gfc_of_rows, power_error_db
from mmt_lab.bench.measuring import spread
from mmt_lab.bench.textures import RATE_HZ, session
from mmt_lab.harness.experiment import Experiment
from mmt_lab.harness.findings import Axis, Cell, Curves, Findings, FindingsTable, Panel, Target

MODEL: Final = "mmt, model"
BACKWARDS: Final = "mmt, repetition"
REPEATED: Final = "block repeated"
SILENCE: Final = "mmt, silence"
GAP: Final = Axis("gap (ms)", "ms")
SPECTRUM: Final = Axis("log-spectral distance of the mean spectra (dB)", "dB")
ALONE: Final = Axis("error of a single gap's spectrum (1 - GFC)", "1 - GFC")
STEP: Final = Axis("largest step at the joints over the signal's", "step")
_WINDOW: Final = 192
_PIECE: Final = 64
_FADE: Final = 5
_DELAY_MS: Final = 4
_FELT_M_S2: Final = 0.3
_TIMED: Final = 40
_NANOSECONDS_PER_US: Final = 1e3

SURFACES: Final = ("plastic", "mesh", "wood", "sandpaper")
DURATION_S: Final = 60.0
GAPS: Final = (2, 5, 10, 20, 50, 100)
COMPARED: Final = (5, 10, 20, 50)
APART: Final = 400
SHIFTS: Final = 2
TIMED_GAPS: Final = 1000


@dataclass(frozen=True)
class Errors:
    """Errors of a method and gap length on a texture: in dB, of single gaps, and at the joints."""

    spectrum_db: float
    alone: float
    step: float


def repeated(gap: int) -> Concealment:
    """Return what plays the last block of the gap's own length again, which only a bench knows."""
    return Continuation(lambda past, gain: gain * np.resize(past[-gap:], len(gain)))


METHODS: Final[Mapping[str, Callable[[int, int], Concealment]]] = {
    MODEL: lambda _gap, seed: Continuation(modelled(seed)),
    BACKWARDS: lambda _gap, _seed: Continuation(backwards),
    REPEATED: lambda gap, _seed: repeated(gap),
    SILENCE: lambda _gap, _seed: FadeOut(),
}
"""What bridges gaps of a length, with a seed, by name."""


def run() -> Findings:
    """Bridge gaps of every length on every texture by every method; time the samples."""
    found = {
        (method, gap): [_errors(surface, gap, method) for surface in SURFACES]
        for gap in GAPS
        for method in METHODS
    }
    spectrum, alone, step = Curves(), Curves(), Curves()
    for (method, gap), errors in found.items():
        spectrum.add(method, gap, gap, spread(np.array([e.spectrum_db for e in errors])))
        alone.add(method, gap, gap, spread(np.array([e.alone for e in errors])))
        step.add(method, gap, gap, spread(np.array([e.step for e in errors])))
    times, first_us, next_us = _times()
    return Findings(
        title="Concealment of gaps",
        about=(
            f"Sessions of {DURATION_S:g} s on {', '.join(SURFACES)}, streamed through "
            "the leader's filter and playout buffer with gaps of one length, "
            f"{APART} ms apart. Compared are {_WINDOW} ms around each gap with the same of "
            "the whole stream, spectra by Welch's method in pieces of "
            f"{_PIECE} ms, 16 to 500 Hz, windows in which nothing is felt left out. The mean "
            "spectra over all gaps of a texture say what is felt around gaps; a single gap's "
            "is mostly chance, since what is lost cannot be known, and a short hole is nearer to "
            "it than another realisation of the same vibration. "
            f'"{REPEATED}" knows the gap\'s length beforehand, which no service does. A '
            "step is the largest from one sample to the next at either joint and in the fade, "
            "over the largest of the whole stream in that window; the mean over gaps. Medians "
            "and quartiles over textures."
        ),
        panels=(
            Panel("spectrum", "Around gaps", "ms", GAP, SPECTRUM, spectrum.done()),
            Panel("alone", "One gap at a time", "ms", GAP, ALONE, alone.done()),
            Panel("step", "Clicks", "ms", GAP, STEP, step.done()),
        ),
        records=(times,),
        targets=_targets(found, first_us, next_us),
    )


def _errors(surface: str, gap: int, method: str) -> Errors:
    """Return the errors of a method on one texture."""
    whole, holed, steps = [], [], []
    true, seed = _whole(surface, DURATION_S), SHIFTS * SURFACES.index(surface)
    count = len(true)
    for shift in range(SHIFTS):
        starts = np.arange(APART + shift * APART // SHIFTS, count - APART, APART)
        lost = np.zeros(count, dtype=bool)
        lost[(starts[:, np.newaxis] + np.arange(gap)).ravel()] = True
        bridged = played(surface, DURATION_S, lost, METHODS[method](gap, seed + shift))
        starts_out = starts + _DELAY_MS
        whole.append(_windows(true, starts_out + gap // 2))
        holed.append(_windows(bridged, starts_out + gap // 2))
        steps.append(_steps(true, bridged, starts_out, gap))
    first, second, ratio = np.concatenate(whole), np.concatenate(holed), np.concatenate(steps)
    level = np.sqrt(np.mean(first**2, axis=1, keepdims=True))
    felt = level[:, 0] > _FELT_M_S2
    amplitudes = [
        amplitude_spectra(rows[felt] / level[felt], RATE_HZ, _PIECE)[1][:, 1:]
        for rows in (second, first)
    ]
    own, truth = (np.mean(rows**2, axis=0) for rows in amplitudes)
    return Errors(
        spectrum_db=root_mean_square(power_error_db(own, truth)),
        alone=1.0 - float(gfc_of_rows(*amplitudes).mean()),
        step=float(ratio[felt].mean()),
    )


def played(
    surface: str, duration_s: float, lost: BoolArray, concealment: Concealment | None = None
) -> FloatArray:
    """Return what the leader plays of a session (n,) without the frames that are lost (n,)."""
    frames = session(surface, duration_s).frames
    buffer = PlayoutBuffer(_DELAY_MS, concealment=concealment)
    vibration = StreamedVibration(buffer, "z", RATE_HZ)
    output = np.empty(len(frames))
    for index, (now_ns, missing) in enumerate(
        zip(frames["time_ns"].tolist(), lost.tolist(), strict=True)
    ):
        if not missing:
            vibration.on_frames(frames[index : index + 1], now_ns)
        (output[index],) = buffer.pull(now_ns)
    return output


@cache
def _whole(surface: str, duration_s: float) -> FloatArray:
    return played(surface, duration_s, np.zeros(round(duration_s * RATE_HZ), dtype=bool))


def _windows(signal: FloatArray, middles: IntArray) -> FloatArray:
    rows: FloatArray = signal[(middles - _WINDOW // 2)[:, np.newaxis] + np.arange(_WINDOW)]
    return rows


def _steps(true: FloatArray, bridged: FloatArray, starts_out: IntArray, gap: int) -> FloatArray:
    """Return the largest step at the joints of each gap over that of the whole stream near it."""
    own = np.abs(np.diff(_windows(true, starts_out + gap // 2))).max(axis=1)
    into = np.abs(bridged[starts_out] - bridged[starts_out - 1])
    back = (starts_out + gap - 1)[:, np.newaxis] + np.arange(_FADE + 1)
    out = np.abs(np.diff(bridged[back])).max(axis=1)
    ratio: FloatArray = np.maximum(into, out) / np.where(own > 0.0, own, 1.0)
    return ratio


def _times() -> tuple[FindingsTable, float, float]:
    """Time the first and the further samples of gaps, and samples that are there."""
    values = _whole(SURFACES[0], DURATION_S)[1000:1400].tolist()
    rows: list[Mapping[str, Cell]] = []
    medians = {}
    for method, make in METHODS.items():
        if method == REPEATED:
            continue
        first, further, there = _time_gaps(make(_TIMED, 1), values, TIMED_GAPS)
        medians[method] = float(np.median(first)), float(np.median(further))
        rows.append(
            {
                "": method,
                "first of a gap, p50 (µs)": medians[method][0],
                "p99 (µs)": float(np.percentile(first, 99.0)),
                "further ones (µs)": medians[method][1],
                "while nothing is missing (µs)": float(np.median(there)),
            }
        )
    return FindingsTable("times", "Time of a sample", tuple(rows)), *medians[MODEL]


def _time_gaps(concealment: Concealment, values: list[float], count: int) -> FloatArray:
    """Return the microseconds of gaps' first and further samples, and of others; (3, count)."""
    for value in values:
        concealment.play((value,))
    times = np.empty((3, count))
    for index in range(count):
        instants = [time.perf_counter_ns()]
        concealment.bridge()
        instants.append(time.perf_counter_ns())
        for _ in range(_TIMED):
            concealment.bridge()
        instants.append(time.perf_counter_ns())
        for value in values[:_FADE]:
            concealment.play((value,))
        between = time.perf_counter_ns()
        for value in values:
            concealment.play((value,))
        there = (time.perf_counter_ns() - between) / len(values)
        first, further = np.diff(instants)
        times[:, index] = first, further / _TIMED, there
    return times / _NANOSECONDS_PER_US


def _targets(
    found: Mapping[tuple[str, int], list[Errors]], first_us: float, next_us: float
) -> tuple[Target, ...]:
    def worst(other: str) -> float:
        """Return the largest ratio over lengths of the mean errors over textures."""
        means = {
            key: float(np.mean([e.spectrum_db for e in errors])) for key, errors in found.items()
        }
        return max(means[MODEL, gap] / means[other, gap] for gap in COMPARED)

    span = f"gaps of {COMPARED[0]} to {COMPARED[-1]} ms"
    step = max(e.step for gap in GAPS for e in found[MODEL, gap])
    return (
        *(
            Target(f"spectral error of the model over {other}, {span}", worst(other), "at most", 1)
            for other in (SILENCE, BACKWARDS, REPEATED)
        ),
        Target("step at the joints over the signal's largest, model", step, "at most", 1),
        Target("first sample of a gap, model (µs)", first_us, "at most", 100),
        Target("further samples of a gap, model (µs)", next_us, "at most", 3),
    )


EXPERIMENT = Experiment(
    shows="what is felt around gaps in streamed vibration, by their length",
    duration="1 min",
    run=run,
    group="bench",
)
