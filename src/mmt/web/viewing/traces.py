"""What the page shows of a recording: curves, events, and statistics of the link.

Missing values are NaN, so that no line is drawn across a gap.
"""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np

from mmt.core.arrays import FloatArray, IntArray, RecordArray
from mmt.core.frames import acceleration_samples, samples_per_frame
from mmt.session.data import JsonObject, OutputBlock, clock_offset_ns, compares_clocks
from mmt.session.windows import Window
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.biquad import VIBRATION_CUTOFF_HZ, BiquadFilter, butterworth_high_pass
from mmt.texture.signals.filtering import StreamFilter
from mmt.texture.synthesis.synthesizer import Synthesizer
from mmt.web.monitor.states import LATENCY_MS

Kind = Literal["mark", "gap", "criterion", "other"]
_SURFACE_CHANGES: Final = ("new", "recalled", "identified")
_MOST: Final = 2000
"""Most events that a page receives."""


@dataclass(frozen=True)
class SessionEvent:
    """An event as the page lists it."""

    at_s: float
    kind: Kind
    sentence: str


def session_events(events: Sequence[JsonObject]) -> list[SessionEvent]:
    """Return the events to list, in order.

    Comparisons of clocks and filled gaps are left out; beyond 2000 events, all gaps as well.
    """
    found = [h for event in events if (h := _session_event(event)) is not None]
    if len(found) > _MOST:
        found = [h for h in found if h.kind != "gap"]
    return found[:_MOST]


def switch_s(events: Sequence[JsonObject]) -> float | None:
    """Return when the model first drove the vibration, or None if there is no such event."""
    return next((e["at_s"] for e in events if e.get("event") == "vibration synthesized"), None)


def _session_event(event: JsonObject) -> SessionEvent | None:
    sentence, at_s = str(event.get("event", "")), max(0.0, float(event["at_s"]))
    if event.get("kind") == "gap":
        return SessionEvent(at_s, "gap", f"{event.get('frames', 'some')} frames did not arrive")
    if event.get("kind") == "filled" or "clock_uncertainty_ns" in event or not sentence:
        return None
    if "mark" in event:
        return SessionEvent(at_s, "mark", sentence)
    criterion = sentence.startswith(("start criterion", "stop criterion"))
    criterion |= event.get("kind") in _SURFACE_CHANGES
    return SessionEvent(at_s, "criterion" if criterion else "other", sentence)


class LinkRecord:
    """Statistics of the link in a recording.

    Parameters
    ----------
    events
        Events of the recording, in order.
    """

    def __init__(self, events: Sequence[JsonObject]) -> None:
        self._clocks = [event for event in events if compares_clocks(event)]
        self._steps_s = [event["at_s"] for event in events if "clock_step_ns" in event]
        self._gaps = [event for event in events if event.get("kind") in ("gap", "filled")]

    @property
    def exists(self) -> bool:
        """Whether the recording has any such statistics."""
        return bool(self._clocks or self._gaps)

    def at(self, time_s: float, arrivals: IntArray) -> dict[str, Any]:
        """Return the statistics at a recording time.

        Parameters
        ----------
        time_s
            Recording time; later events are ignored.
        arrivals
            Shape (m, 2), of the blocks of the last seconds; see `mmt.session.windows.Window`.
        """
        past = [event for event in self._gaps if event["at_s"] <= time_s]
        missed = sum(_count(event, "frames") for event in past if event["kind"] == "gap")
        filled = [event for event in past if event["kind"] == "filled"]
        lost = sum(_count(event, "lost") for event in filled)
        table: dict[str, Any] = {
            "missed": missed,
            "filled": sum(_count(event, "frames") for event in filled) - lost,
            "lost": lost,
            "clock": None,
        }
        if not self._clocks:
            return table
        steps = bisect_right(self._steps_s, time_s)
        clock = min(
            self._clocks,
            key=lambda event: (
                bisect_right(self._steps_s, event["at_s"]) != steps,  # the other side of a jump
                abs(float(event["at_s"]) - time_s),
            ),
        )
        came_ns, sent_ns = arrivals.T
        latencies_ms = (came_ns - sent_ns + clock_offset_ns(clock, came_ns)) / 1e6
        edges = np.array([-np.inf, *LATENCY_MS, np.inf])
        table["clock"] = {
            "offset_ms": float(clock["clock_offset_ns"]) / 1e6,
            "drift_ppm": float(clock["clock_drift_ppm"]),
            "uncertainty_ms": float(clock["clock_uncertainty_ns"]) / 1e6,
        }
        if len(latencies_ms):
            p50, p99 = np.percentile(latencies_ms, [50, 99]).tolist()
            table |= {"latency_p50_ms": p50, "latency_p99_ms": p99}
        table["bounds_ms"] = list(LATENCY_MS)
        table["counts"] = np.histogram(latencies_ms, edges)[0].tolist()
        return table


def _count(event: JsonObject, name: str) -> int:
    value = event.get(name, 0)
    return value if isinstance(value, int) else 0


SHOWN: Final = 512
"""Samples of vibration on the page, at the vibration's rate: half a second at 1 kHz."""
RECENT_S: Final = 10.0
"""Length of the window before a moment, for the trail and the latencies."""
_COURSE_POINTS: Final = 1500
_GAP: Final = 40
"""Number of missing frames beyond which no line is drawn; back-filled frames are not missing."""
_STEP: Final = 40
"""Frames between two points of a trail: 25 points a second, as in the live monitor."""
_TRAIL: Final = 120
_SETTLING: Final = 200
_LATE_S: Final = 0.05
"""Largest offset between the end of a block and the beginning of one that continues it."""
_BLOCK: Final = 1000
"""Rendering begins at a multiple of so many frames, so that overlapping moments agree."""


@dataclass(frozen=True, eq=False)
class Played:
    """The actuator's last samples (512,), and for each 1 if a model contributed, else 0."""

    vibration_m_s2: FloatArray
    modelled: FloatArray


def numbers(frames: RecordArray) -> IntArray:
    """Return the sequence numbers (n,) of frames."""
    return np.asarray(frames["sequence"], dtype=np.int64)


def measured(window: Window, end_s: float, settings: ModellingSettings) -> FloatArray:
    """Return the last samples of the high-passed acceleration (512,) before a moment."""
    if "acceleration_m_s2" not in (window.frames.dtype.names or ()):
        return np.full(SHOWN, np.nan)
    several = samples_per_frame(window.frames.dtype)
    newest = slice(-(-(-SHOWN // several) + _SETTLING), None)
    frames, time_s = window.frames[newest], window.time_s[newest]
    axis = "xyz".index(settings.normal if settings.axis == "dft321" else settings.axis)
    high_pass = BiquadFilter(butterworth_high_pass(VIBRATION_CUTOFF_HZ, settings.rate_hz * several))
    values = high_pass.steps(acceleration_samples(frames)[:, axis].tolist())
    last = _last_number(frames, time_s, end_s)
    return _placed(np.array(values), numbers(frames), last, several)


def played(outputs: Sequence[OutputBlock], end_s: float) -> Played:
    """Return the last samples that the leader wrote to its actuator before a moment.

    A late tick writes the samples of missed ticks as well, so the samples have no gap although
    the times of blocks do. Blocks that nearly meet are therefore joined.
    """
    vibration, modelled = np.full(SHOWN, np.nan), np.zeros(SHOWN)
    later = None
    for block in reversed(outputs):
        count = len(block.vibration_m_s2)
        first = SHOWN - round((end_s - block.time_s) * block.rate_hz)
        if later is not None and abs(later - first - count) <= _LATE_S * block.rate_hz:
            first = later - count
        later = first
        begin, stop = max(0, first), min(SHOWN, first + count)
        if begin < stop:
            vibration[begin:stop] = block.vibration_m_s2[begin - first : stop - first]
            modelled[begin:stop] = block.mode in ("synthesized", "fading")
    return Played(vibration, modelled)


def synthesized(
    window: Window, end_s: float, settings: ModellingSettings, model: TextureModel
) -> Played:
    """Render the recorded motion from a model; the same moment gives the same samples."""
    several = settings.samples_per_frame
    last = _last_number(window.frames, window.time_s, end_s)
    begin = (last - -(-SHOWN // several) - _SETTLING) // _BLOCK * _BLOCK
    frames = window.frames[numbers(window.frames) >= begin - _SETTLING]
    aligned = StreamFilter(settings).process(frames)
    aligned = aligned[int(np.searchsorted(aligned.index, begin)) :]
    if len(aligned) == 0:  # no frames, or no more than the filter holds back after a gap
        return Played(np.full(SHOWN, np.nan), np.ones(SHOWN))
    velocity = np.ascontiguousarray(aligned.velocity_mm_s.T)
    motion = (*velocity,) if model.space.directed else (aligned.speed_mm_s,)
    frame = np.arange(len(aligned.index))
    sample = np.arange(1 - several, several * (len(frame) - 1) + 1) / several
    inputs = [np.interp(sample, frame, one) for one in (*motion, aligned.normal_force_n)]
    rendered = Synthesizer(model, seed=begin % 2**31).render(*inputs)
    return Played(_placed(rendered, aligned.index, last, several), np.ones(SHOWN))


def course(window: Window) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times (k,), force (3, k), position (3, k) at an even step; k <= 1500 plus gaps."""
    step = max(1, -(-len(window.frames) // _COURSE_POINTS))
    time_s, frames = window.time_s[::step], window.frames[::step]
    columns = [_vectors(frames, name) for name in ("force_n", "position_mm")]
    gaps = np.flatnonzero(np.diff(numbers(frames)) > step + _GAP) + 1
    force, position = (np.insert(column, gaps, np.nan, axis=1) for column in columns)
    return np.insert(time_s, gaps, time_s[gaps - 1] + 1e-3), force, position


def modes(outputs: Sequence[OutputBlock]) -> list[tuple[float, float, str]]:
    """Return spans (begin in s, end in s, "streamed" or "synthesized") of the actuator's output.

    Silence gives no span.
    """
    spans: list[tuple[float, float, str]] = []
    for block in outputs:
        mode = "synthesized" if block.mode == "fading" else block.mode
        begin_s, end_s = block.time_s, block.end_s
        if spans and spans[-1][2] == mode and begin_s - spans[-1][1] < _LATE_S:
            begin_s, _, _ = spans.pop()
        spans.append((begin_s, end_s, mode))
    return [span for span in spans if span[2] != "silent"]


def motion_trace(window: Window, settings: ModellingSettings) -> FloatArray:
    """Return tangential velocity along two axes and normal force (k, 3) of the last seconds."""
    names = window.frames.dtype.names or ()
    if "position_mm" not in names or "force_n" not in names:
        return np.zeros((0, 3))
    frames = window.frames[-(_TRAIL * _STEP + 1) :]
    count = (len(frames) - 1) // _STEP
    if count < 1:
        return np.zeros((0, 3))
    frames = frames[len(frames) - 1 - count * _STEP :]
    normal = "xyz".index(settings.normal)
    tangential = [axis for axis in range(3) if axis != normal]
    steps = np.diff(numbers(frames[::_STEP])) / settings.rate_hz
    moved = np.diff(frames["position_mm"][::_STEP][:, tangential].astype(np.float64), axis=0)
    velocity = moved / np.where(steps > 0, steps, np.nan)[:, None]
    force = frames["force_n"][1:, normal].astype(np.float64).reshape(count, _STEP).mean(axis=1)
    points = np.column_stack([velocity, np.maximum(force, 0.0)])
    points[steps > 4 * _STEP / settings.rate_hz] = np.nan
    return points


def _vectors(frames: RecordArray, name: str) -> FloatArray:
    """Return a channel (3, n), or NaN if the recording lacks the channel."""
    if name not in (frames.dtype.names or ()):
        return np.full((3, len(frames)), np.nan)
    return np.asarray(frames[name].T, dtype=np.float64)


def _last_number(frames: RecordArray, time_s: FloatArray, end_s: float) -> int:
    """Return the sequence number that a frame at a moment would have."""
    if len(frames) == 0:
        return 0
    return int(frames["sequence"][-1]) + max(0, round((end_s - float(time_s[-1])) * 1e3) - 1)


def _placed(values: FloatArray, sequence: IntArray, last: int, several: int) -> FloatArray:
    """Return the last 512 of the values (n k,) of frames (n,) up to `last`; NaN for gaps."""
    shown = np.full(SHOWN, np.nan)
    samples = (several * sequence[:, None] + np.arange(several)).ravel()
    places = samples - (several * (last + 1) - SHOWN)
    inside = (places >= 0) & (places < SHOWN)
    shown[places[inside]] = values[inside]
    return shown
