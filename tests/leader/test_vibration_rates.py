"""Vibration of k kHz beside frames of 1 kHz, from the acceleration to the last guard."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal
from test_concealment import DELAY, MS, WAYS, textured

from mmt.core.frames import frame_dtype
from mmt.core.guards import VibrationSlew
from mmt.devices.protocols import InterfaceState
from mmt.leader.output.concealment import LONGEST_FRAMES, build_concealment
from mmt.leader.output.stream import PlayoutBuffer, StreamedVibration
from mmt.leader.output.vibration import VibrationPart, VibrationSwitch
from mmt.leader.part import Session, Tick
from mmt.scene.files import scene_from_tables
from mmt.testing.simulation.actuator import SimulatedActuator

SEVERAL = st.sampled_from([1, 2, 5, 10])


def streamed(values, k, way, lost=(), axis="z"):
    """Return what the switch plays of an acceleration along z of which frames are lost."""
    count = len(values) // k
    frames = np.zeros(count, frame_dtype(samples_per_frame=k))
    frames["sequence"] = np.arange(count)
    frames["time_ns"] = MS * np.arange(count)
    along = frames["acceleration_m_s2"][..., 2]
    along[:] = (9.81 + values).reshape(along.shape)
    buffer = PlayoutBuffer(DELAY, concealment=build_concealment(way, 1, k))
    stream = StreamedVibration(buffer, axis, 1000.0, k)
    switch = VibrationSwitch(buffer.pull, None, crossfade_samples=0, samples_per_tick=k)
    played, missing = [], set(lost)
    for number in range(count):
        if number not in missing:
            stream.on_frames(frames[number : number + 1], number * MS)
        played.append(switch.render(number * MS, np.zeros(k), np.zeros(k)))
    return np.concatenate(played)


def high_passed(values, k):
    """Return what scipy makes of the acceleration, begun in the first sample's steady state."""
    b, a = signal.butter(2, 10.0, "highpass", fs=1000.0 * k)
    measured = (9.81 + values).astype(np.float32).astype(np.float64)
    return np.asarray(signal.lfilter(b, a, measured, zi=measured[0] * signal.lfilter_zi(b, a))[0])


@given(k=SEVERAL, way=st.sampled_from(WAYS), seed=st.integers(0, 99))
@settings(max_examples=30)
def test_a_stream_is_played_as_it_is_a_delay_later(k, way, seed):
    values = textured(300, seed, k)
    played, fade = streamed(values, k, way), 5
    wanted = high_passed(values, k)
    np.testing.assert_allclose(
        played[(DELAY + fade) * k :], wanted[fade * k : -DELAY * k], atol=1e-9
    )


@given(k=SEVERAL, way=st.sampled_from(WAYS), length=st.integers(1, 200))
@settings(max_examples=40)
def test_nothing_is_invented_for_longer_than_a_tenth_of_a_second(k, way, length):
    values = textured(500, k=k)
    played = streamed(values, k, way, range(200, 200 + length))
    begin, end = 200 + DELAY, 200 + DELAY + length
    silent = played[(begin + LONGEST_FRAMES + 20) * k : end * k]
    assert (silent == 0.0).all()
    full = played[begin * k : min(end, begin + 50) * k]
    if way != "silence" and length > 20:
        assert 0.3 < full.std() / played[100 * k : begin * k].std() < 2.0


@pytest.mark.parametrize("length", [3, 30, 90])
def test_after_a_gap_the_stream_comes_back_without_an_offset(length):
    """A high-pass that restarts at every gap would give 9.81 m/s2 and half the vibration."""
    lost, values = range(1500, 1500 + length), textured(3000)
    whole, holed = streamed(values, 1, "model"), streamed(values, 1, "model", lost)
    error = (holed - whole)[lost.stop + DELAY + 5 : lost.stop + DELAY + 25]
    assert np.sqrt(np.mean(error**2)) < 0.35 * np.std(whole)


class Heard:
    """Notes what drives it; plays its first input."""

    directed = False

    def __init__(self):
        self.speeds = []

    def render(self, *inputs):
        self.speeds += inputs[0].tolist()
        return inputs[0].copy()


@given(
    k=SEVERAL,
    ticks=st.lists(st.tuples(st.integers(1, 4), st.floats(0.0, 50.0)), min_size=1, max_size=20),
)
def test_the_motion_goes_along_lines_between_the_ticks(k, ticks):
    tables = {"link": {}, "simulated": {}, "hand": {}, "playout": {}, "actuator": {}}
    rate = {"acceleration_rate_hz": 1000 * k}
    session = Session(scene_from_tables({"session": rate, **tables}))
    heard, actuator = Heard(), SimulatedActuator(limit_m_s2=60.0)
    switch = VibrationSwitch(None, heard, crossfade_samples=0, samples_per_tick=k)
    switch.use_model(True)
    part = VibrationPart(session, actuator, switch, VibrationSlew(60.0, samples_per_tick=k))
    outputs = []
    part._on_output.append(
        lambda first_ns, _, vibration: outputs.append((first_ns, len(vibration)))
    )
    now, wanted, before = 0, [], ticks[0][1]
    for elapsed, speed in ticks:
        now += elapsed
        state = InterfaceState((0.0, 0.0, -1.0), (speed, 0.0, 0.0), 1.0, True)
        part.tick(Tick(now_ns=now * MS, elapsed=elapsed, begun=True, state=state))
        line = before + (speed - before) * np.arange(1, k + 1) / k
        wanted += [*line, *[speed] * (k * (elapsed - 1))]
        assert heard.speeds[-1] == pytest.approx(speed, abs=1e-9)
        before = speed
    np.testing.assert_allclose(heard.speeds, wanted, atol=1e-9)
    assert actuator.statistics.samples == now * k == len(wanted)
    # what is told of the output follows without a gap, its last sample at the tick's time
    ends_ns = [first_ns + (count - 1) * MS / k for first_ns, count in outputs]
    np.testing.assert_allclose(ends_ns, MS * np.cumsum([elapsed for elapsed, _ in ticks]), atol=1)


@given(
    k=SEVERAL,
    values=st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=1, max_size=80),
    silent=st.booleans(),
)
def test_limit_and_slew_hold_for_every_sample(k, values, silent):
    largest_step = 60_000.0 / (1000.0 * k)
    slew = VibrationSlew(60.0, largest_step, k)
    blocks = [np.array(values[at : at + k]) for at in range(0, len(values), k)]
    for number, block in enumerate(blocks):
        slew.limit(block, silent=silent and number > 2)
    played = np.concatenate([[0.0], *blocks])
    assert np.isfinite(played).all()
    assert np.abs(played).max() <= 60.0
    assert np.abs(np.diff(played)).max() <= largest_step + 1e-9
