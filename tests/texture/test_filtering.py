"""Frames of a stream are numbered, filtered and brought to one instant."""

from dataclasses import fields

import numpy as np
import pytest
import scipy.integrate
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.core.frames import empty_frames
from mmt.core.sequence_numbers import SEQUENCES
from mmt.texture.settings import LONGEST_BRIDGED, ModellingSettings
from mmt.texture.signals.aligned import AlignedBlock, dft321
from mmt.texture.signals.biquad import bessel_low_pass, butterworth_high_pass
from mmt.texture.signals.bridging import LARGEST_MEASUREMENT
from mmt.texture.signals.filtering import StreamFilter, StreamNumbering

RATE_HZ = 1000.0
WARM_UP = butterworth_high_pass(10.0, RATE_HZ).settling_samples(0.05)
GRAVITY_M_S2 = 9.81


def make_frames(count, first=0):
    frames = empty_frames(count)
    frames["sequence"] = np.arange(first, first + count)
    frames["time_ns"] = 5_000 + frames["sequence"].astype(np.int64) * 1_000_000
    return frames


def random_frames(count, seed=1):
    generator = np.random.default_rng(seed)
    frames = make_frames(count)
    frames["position_mm"] = np.cumsum(generator.normal(size=(count, 3)), axis=0)
    frames["force_n"] = 1.0 + generator.normal(size=(count, 3))
    frames["acceleration_m_s2"] = GRAVITY_M_S2 + generator.normal(size=(count, 3))
    return frames


def in_blocks(stream, frames, lengths):
    blocks, at = [], 0
    for length in lengths:
        blocks.append(stream.process(frames[at : at + length]))
        at += length
    blocks.append(stream.process(frames[at:]))
    return AlignedBlock.concatenate(blocks)


def assert_identical(one, other):
    for field in fields(AlignedBlock):
        left, right = getattr(one, field.name), getattr(other, field.name)
        assert left.dtype == right.dtype
        np.testing.assert_array_equal(left, right, err_msg=field.name)


@st.composite
def damaged_streams(draw):
    """Frames with gaps, repeats, late ones and broken numbers, and a cut into blocks."""
    count = draw(st.integers(0, 260))
    frames = random_frames(count, seed=draw(st.integers(0, 50)))
    positions = st.integers(0, max(count - 1, 0))
    if count:
        for _ in range(draw(st.integers(0, 3))):
            frames["sequence"][draw(positions) :] += np.uint32(draw(st.integers(1, 5000)))
        for _ in range(draw(st.integers(0, 2))):
            frames[draw(positions)] = frames[draw(positions)]
        for _ in range(draw(st.integers(0, 2))):
            broken = draw(st.sampled_from([np.nan, np.inf, -np.inf, 3e38]))
            frames[draw(st.sampled_from(["position_mm", "force_n", "acceleration_m_s2"]))][
                draw(positions)
            ] = broken
    return frames, draw(st.lists(st.integers(0, 60), max_size=12))


@given(damaged=damaged_streams(), axis=st.sampled_from(["x", "z", "dft321"]))
@settings(max_examples=100)
def test_gives_out_received_frames_and_finite_numbers_however_they_come(damaged, axis):
    frames, lengths = damaged
    chosen = ModellingSettings(axis=axis)
    aligned = StreamFilter(chosen).process(frames)
    for cut in (lengths, [1] * len(frames)):
        assert_identical(in_blocks(StreamFilter(chosen), frames, cut), aligned)
    received = set(StreamNumbering().number(frames)["sequence"].tolist())
    assert np.all(np.diff(aligned.index) > 0)
    assert set(aligned.index[aligned.measured].tolist()) <= received
    gaps = np.diff(sorted(received), prepend=min(received, default=0))
    filled = {
        last - back
        for last, gap in zip(sorted(received), gaps.tolist(), strict=True)
        for back in range(1, gap if gap <= LONGEST_BRIDGED + 1 else 1)
    }
    assert set(aligned.index.tolist()) <= received | filled
    for field in fields(AlignedBlock):
        assert np.isfinite(getattr(aligned, field.name)).all()
    assert (aligned.normal_force_n >= 0.0).all()


def test_each_run_of_frames_loses_its_newest_ones_and_its_warm_up():
    stream = StreamFilter()
    first, second = random_frames(300), random_frames(200)
    first["sequence"] += 7
    second["sequence"] += 400
    for part in (first, second):
        part["time_ns"] = 5_000 + part["sequence"].astype(np.int64) * 1_000_000
    aligned = stream.process(np.concatenate([first, second]))
    delay, warm_up = stream.delay_samples, WARM_UP
    expected = np.r_[7 : 307 - delay, 400 : 600 - delay]
    np.testing.assert_array_equal(aligned.index, expected)
    np.testing.assert_array_equal(aligned.time_ns, 5_000 + expected * 1_000_000)
    # Behind the gap the offset of the acceleration is known; position and force begin anew.
    motion = bessel_low_pass(20.0, RATE_HZ).settling_samples(0.05) - delay
    valid = np.where(expected < 400, expected - 7 >= warm_up, expected - 400 >= motion)
    np.testing.assert_array_equal(aligned.valid, valid)
    assert motion + delay <= 50
    assert aligned.measured.all()


@pytest.mark.parametrize("normal", range(3))
def test_channels_equal_scipys_filters(normal):
    frames = random_frames(500)
    stream = StreamFilter(ModellingSettings(normal="xyz"[normal], axis="x"))
    aligned = stream.process(frames)
    low = scipy.signal.bessel(2, 20.0, fs=RATE_HZ, norm="mag")
    high = scipy.signal.butter(2, 10.0, "highpass", fs=RATE_HZ)

    def settled(taps, x):
        state = scipy.signal.lfilter_zi(*taps)[:, None] * x[:1]
        return scipy.signal.lfilter(*taps, x, axis=0, zi=state)[0]

    delay = stream.delay_samples
    position_mm = settled(low, frames["position_mm"].astype(float))
    velocity_mm_s = np.diff(position_mm, axis=0, prepend=position_mm[:1]) * RATE_HZ
    np.testing.assert_allclose(aligned.position_mm, position_mm[delay:], atol=1e-10)
    tangential_mm_s = np.delete(velocity_mm_s[delay:], normal, axis=1)
    speed_mm_s = np.linalg.norm(tangential_mm_s, axis=1)
    np.testing.assert_allclose(aligned.speed_mm_s, speed_mm_s, atol=1e-7)
    force_n = settled(low, frames["force_n"][:, [normal]].astype(float))[delay:, 0]
    np.testing.assert_allclose(aligned.normal_force_n, np.maximum(force_n, 0.0), atol=1e-10)
    vibration = settled(high, frames["acceleration_m_s2"][:, :1].astype(float))
    np.testing.assert_allclose(aligned.vibration_m_s2[:, 0], vibration[:-delay], atol=1e-10)


def lag_samples(channel, truth, index):
    """By how many samples a channel lags behind the truth: the correlation's vertex.

    The truth is known around the channel too, so that no shift loses samples at the ends.
    """
    shifts = np.arange(-30, 31)
    match = [np.corrcoef(channel, truth[index - shift])[0, 1] for shift in shifts]
    peak = int(np.argmax(match))
    below, top, above = match[peak - 1 : peak + 2]
    return float(shifts[peak] + 0.5 * (below - above) / (below - 2.0 * top + above))


@pytest.mark.parametrize("carrier_hz", [90.0, 240.0])
def test_channels_belong_to_the_same_instant(carrier_hz):
    frames = make_frames(8000)
    time_s = np.arange(8000) / RATE_HZ
    truth = 1.0 + 0.4 * scipy.signal.chirp(time_s, 0.3, time_s[-1], 5.0, phi=-90.0)
    travel_mm = scipy.integrate.cumulative_trapezoid(50.0 * truth, time_s, initial=0.0)
    frames["position_mm"][:, 0] = 0.6 * travel_mm
    frames["position_mm"][:, 1] = 0.8 * travel_mm
    frames["force_n"][:, 2] = truth
    carrier = np.sin(2.0 * np.pi * carrier_hz * time_s)
    frames["acceleration_m_s2"][:, 2] = GRAVITY_M_S2 + 10.0 * truth * carrier
    stream = StreamFilter()
    aligned = stream.process(frames)
    kept = aligned[600:-600]
    envelope = np.abs(scipy.signal.hilbert(aligned.vibration_m_s2[:, 0, 0]))[600:-600]
    speed = lag_samples(kept.speed_mm_s, truth, kept.index)
    force = lag_samples(kept.normal_force_n, truth, kept.index)
    vibration = lag_samples(envelope, truth, kept.index)
    assert max(abs(speed - vibration), abs(force - vibration)) < 1.0
    assert abs(vibration) < 0.5
    # The low-pass delays by 10.82, the difference by half; a lag is against the frame's instant.
    assert stream.delay_samples == 11
    assert speed == pytest.approx(11.32 - 11, abs=0.05)
    assert force == pytest.approx(10.82 - 11, abs=0.05)


def test_motion_and_force_restart_behind_a_long_gap_as_if_new():
    before, after = random_frames(300, seed=1), random_frames(300, seed=2)
    after["sequence"] += 300 + LONGEST_BRIDGED + 1
    after["position_mm"] += 500.0
    stream = StreamFilter(ModellingSettings(axis="dft321"))
    joined = stream.process(np.concatenate([before, after]))
    fresh = StreamFilter(ModellingSettings(axis="dft321")).process(after)
    for name in ("index", "time_ns", "position_mm", "velocity_mm_s", "normal_force_n"):
        behind = getattr(joined, name)[-len(fresh) :]
        np.testing.assert_array_equal(behind, getattr(fresh, name), err_msg=name)
    assert joined[: len(joined) - len(fresh)].speed_mm_s.max() < 1e4


@pytest.mark.parametrize("gap", [6, 50, 3000])
@pytest.mark.parametrize("broken", [False, True])
def test_vibration_goes_on_behind_a_long_gap_where_it_would_have_been(gap, *, broken):
    frames = random_frames(6000, seed=gap)
    whole = StreamFilter().process(frames)
    damaged = np.delete(frames, np.s_[1000 : 1000 + gap])
    if broken:
        damaged = frames.copy()
        damaged["acceleration_m_s2"][1000 : 1000 + gap] = np.nan
    aligned = StreamFilter().process(damaged)
    behind = aligned[int(np.searchsorted(aligned.index, 1000 + gap)) :]
    assert behind.valid[30:].all()
    error = (behind.vibration_m_s2 - whole[-len(behind) :].vibration_m_s2)[30:100]
    assert np.sqrt(np.mean(error**2)) < 0.12  # of 1 m/s2 rms


def test_an_offset_that_a_gap_has_changed_settles_first():
    frames = random_frames(2000)
    frames["acceleration_m_s2"][1000:] += 30.0
    stream = StreamFilter()
    aligned = stream.process(np.delete(frames, np.s_[900:1000]))
    behind = aligned[int(np.searchsorted(aligned.index, 1000)) :]
    assert int(np.argmax(behind.valid)) == WARM_UP
    assert np.abs(behind.vibration_m_s2[behind.valid]).max() < 6.0


def test_a_broken_number_in_an_unused_channel_does_no_harm():
    frames = random_frames(400)
    expected = StreamFilter(ModellingSettings(axis="z")).process(frames)
    frames["acceleration_m_s2"][200, 0] = np.nan
    frames["force_n"][201, 1] = np.nan
    assert_identical(StreamFilter(ModellingSettings(axis="z")).process(frames), expected)


@pytest.mark.parametrize("count", [0, 1, 11, 12])
def test_few_frames(count):
    aligned = StreamFilter(ModellingSettings(axis="dft321")).process(random_frames(count))
    assert len(aligned) == max(0, count - 11)
    assert aligned.position_mm.shape == (len(aligned), 3)
    assert aligned.vibration_m_s2.shape == (len(aligned), 1, 3)


def test_a_teleporting_position_is_bounded_and_passes():
    frames = make_frames(1000)
    frames["position_mm"][500:, 0] = LARGEST_MEASUREMENT
    aligned = StreamFilter().process(frames)
    assert aligned.speed_mm_s.max() < LARGEST_MEASUREMENT * RATE_HZ
    assert aligned.speed_mm_s[800:].max() < 1.0


def frames_of(first, count, time_ms=0):
    frames = empty_frames(count)
    frames["sequence"] = (first + np.arange(count)) % SEQUENCES
    frames["time_ns"] = (time_ms + np.arange(count)) * 1_000_000
    return frames


@given(st.integers(0, SEQUENCES - 1), st.lists(st.integers(1, 400), min_size=1, max_size=8))
def test_numbers_go_on_where_they_wrap_whatever_the_parts(first, parts):
    frames, numbering = frames_of(first, sum(parts)), StreamNumbering()
    pieces = np.split(frames, np.cumsum(parts)[:-1])
    numbers = np.concatenate([numbering.number(part)["sequence"] for part in pieces])
    np.testing.assert_array_equal(numbers.astype(np.int64), first + np.arange(len(frames)))


@given(st.integers(0, 5000), st.integers(0, 5000), st.booleans(), st.integers(1, 4000))
def test_a_sender_that_starts_anew_goes_on_behind_a_gap(first, again, own_clock, part):
    before = frames_of(first, 3000, time_ms=10)
    after = frames_of(again, 3000, time_ms=10 if own_clock else 3500)
    if again > first and (own_clock or again >= first + 3000):
        return  # a gap, or frames that came late: nothing tells that the sender is another
    frames, numbering = np.concatenate([before, after]), StreamNumbering()
    pieces = np.split(frames, range(part, len(frames), part))
    numbers = np.concatenate([numbering.number(one)["sequence"] for one in pieces]).astype(int)
    steps = np.diff(numbers)
    assert steps[2999] > 1000
    assert (np.delete(steps, 2999) == 1).all()
    assert numbers[3000] % 1000 == 0


def test_late_and_repeated_frames_keep_their_numbers():
    frames = frames_of(100, 2000)
    tangled = np.insert(frames, [1, 50, 1200, 1200], frames[[0, 49, 300, 1199]])
    assert StreamNumbering().number(tangled) is tangled
    assert len(StreamNumbering().number(frames[:0])) == 0


@given(count=st.integers(1, 400), seed=st.integers(0, 100), exponent=st.integers(-100, 100))
@settings(max_examples=60)
def test_keeps_energy_in_every_bin(count, seed, exponent):
    axes = np.random.default_rng(seed).normal(size=(count, 3)) * 10.0**exponent
    reduced = dft321(axes)
    assert reduced.shape == (count,)
    np.testing.assert_allclose((reduced**2).sum(), (axes**2).sum(), rtol=1e-12)
    power = (np.abs(np.fft.rfft(axes, axis=0)) ** 2).sum(axis=1)
    np.testing.assert_allclose(
        np.abs(np.fft.rfft(reduced)) ** 2, power, rtol=1e-9, atol=1e-12 * power.max()
    )


def test_takes_the_phase_of_the_sum():
    axes = np.random.default_rng(1).normal(size=(256, 3))
    expected = np.angle(np.fft.rfft(axes.sum(axis=1))[1:-1])
    difference = np.angle(np.fft.rfft(dft321(axes))[1:-1]) - expected
    np.testing.assert_allclose(np.exp(1j * difference), 1.0, atol=1e-9)


def test_axes_that_cancel_keep_their_energy():
    signal = np.sin(2.0 * np.pi * 0.1 * np.arange(200))
    reduced = dft321(np.stack([signal, -signal, np.zeros(200)], axis=1))
    assert (reduced**2).sum() == pytest.approx(2.0 * (signal**2).sum(), rel=1e-9)
    assert dft321(np.zeros((0, 3))).shape == (0,)
    np.testing.assert_array_equal(dft321(np.zeros((50, 3))), 0.0)
