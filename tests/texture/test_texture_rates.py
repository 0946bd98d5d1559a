"""Frames with several samples of the acceleration: the same figures as with one, in more detail.

A model of another rate is resampled, and a recording of one is refused.
"""

import numpy as np
import pytest
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st
from stream_samples import stroked
from test_filtering import WARM_UP, assert_identical, in_blocks

import mmt
from mmt.core.errors import InputError
from mmt.core.frames import frame_dtype, samples_per_frame
from mmt.leader.output.model_output import ModelOutput
from mmt.leader.part import Session
from mmt.leader.parts import build_parts
from mmt.scene.files import scene_from_tables
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.online.history import build_model
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.filtering import StreamFilter


def textured(count, per_frame, seed=0):
    """Acceleration (n, k, 3) of a texture with its power at 100 to 400 Hz, and gravity."""
    random = np.random.default_rng(seed)
    band = scipy.signal.butter(2, [100, 400], "bandpass", fs=1000.0 * per_frame, output="sos")
    white = random.standard_normal((count * per_frame, 3)) * np.sqrt(per_frame)
    gravity = np.array([0.1, 0.2, -9.8])
    return (scipy.signal.sosfilt(band, white, axis=0) + gravity).reshape(count, per_frame, 3)


def several(per_frame, **kept):
    return ModellingSettings(samples_per_frame=per_frame, **kept)


@st.composite
def spoilt_streams(draw):
    """Streams with runs that are held, a rail, broken numbers and missing frames; and a cut."""
    per_frame = draw(st.sampled_from([1, 2, 10]))
    count = draw(st.integers(1, 600))
    made = np.round(textured(count, per_frame, draw(st.integers(0, 99))), 2)
    if draw(st.booleans()):
        made = np.minimum(made, np.quantile(made, 0.99, axis=(0, 1)))
    flat = made.reshape(-1, 3)
    for start in draw(st.lists(st.integers(0, len(flat) - 1), max_size=4)):
        flat[start : start + draw(st.integers(2, 20 * per_frame))] = flat[start]
    for broken in draw(st.lists(st.integers(0, len(flat) - 1), max_size=3)):
        flat[broken, 2] = np.nan
    came = np.ones(count, np.bool_)
    for start in draw(st.lists(st.integers(1, count), max_size=4)):
        came[start : start + draw(st.integers(1, 9))] = False
    return stroked(made)[came], draw(st.lists(st.integers(0, 60), max_size=10))


@given(spoilt=spoilt_streams(), axis=st.sampled_from(["z", "dft321"]))
@settings(max_examples=40)
def test_the_cut_into_blocks_does_not_matter(spoilt, axis):
    frames, lengths = spoilt
    kept = several(samples_per_frame(frames.dtype), axis=axis)
    stream = StreamFilter(kept)
    whole = stream.process(frames)
    for cut in (lengths, [1] * len(frames)):
        again = StreamFilter(kept)
        assert_identical(in_blocks(again, frames, cut), whole)
        assert again.faults == stream.faults


@pytest.mark.parametrize("per_frame", [2, 5, 10])
def test_the_vibration_is_filtered_at_its_own_rate_and_meets_the_motion(per_frame):
    acceleration = textured(800, per_frame)
    stream = StreamFilter(several(per_frame, axis="z"))
    aligned = stream.process(stroked(acceleration))
    rate_hz = 1000.0 * per_frame
    high_pass = scipy.signal.butter(2, 10.0, "highpass", fs=rate_hz, output="sos")
    samples = acceleration[:, :, 2].astype(np.float32).ravel().astype(float)
    start = scipy.signal.sosfilt_zi(high_pass) * samples[0]
    expected = scipy.signal.sosfilt(high_pass, samples, zi=start)[0]
    found = aligned.vibration_m_s2.ravel()
    np.testing.assert_allclose(found, expected[: len(found)], atol=1e-9)
    # the speed lags by 11.3 frames, the samples lie half a frame before its time in the mean
    assert stream.delay_samples == 11
    assert aligned.valid[WARM_UP:].all()
    assert not aligned.valid[:WARM_UP].any()


def test_a_frame_is_measured_if_all_its_samples_are():
    acceleration = textured(1500, 10)
    acceleration.reshape(-1, 3)[10_003:10_058] = acceleration.reshape(-1, 3)[10_003]  # 5.5 ms
    stream = StreamFilter(several(10))
    aligned = stream.process(stroked(acceleration))
    assert np.flatnonzero(~aligned.measured).tolist() == list(range(1000, 1006))
    assert aligned.valid[1000 - 100 : 1100].sum() == 194  # six are too many to fill
    assert stream.faults.held_s == pytest.approx(0.006)


@pytest.mark.parametrize("per_frame", [2, 10])
def test_a_texture_has_the_same_level_and_spectrum_at_any_rate(per_frame):
    frames, _ = mmt.simulate_session(mmt.Scene(), surface="wood", duration_s=8.0)
    finer = scipy.signal.resample_poly(
        frames["acceleration_m_s2"].astype(float), per_frame, 1, axis=0
    )
    finer = np.roll(finer, per_frame - 1, axis=0)  # the last of a frame is at its time
    finer += 0.01 * np.random.default_rng(1).standard_normal(finer.shape)
    wide = np.zeros(len(frames), frame_dtype(samples_per_frame=per_frame))
    for name in ("sequence", "time_ns", "position_mm", "force_n"):
        wide[name] = frames[name]
    wide["acceleration_m_s2"] = finer.reshape(len(frames), per_frame, 3)
    usual, found = build_model(frames), build_model(wide)
    assert [u.samples for u in found.updates] == [u.samples for u in usual.updates]
    one, other = usual.updates[-1].model, found.updates[-1].model
    assert other.rate_hz == 1000.0 * per_frame
    np.testing.assert_array_equal(other.samples.inputs, one.samples.inputs)
    apart_db = other.level_db(100.0, 1.0)[0] - one.level_db(100.0, 1.0)[0]
    assert abs(apart_db[0]) < 0.3
    frequencies_hz = np.arange(20.0, 400.0, 5.0)
    spectra = (m.spectrum(100.0, 1.0, frequencies_hz=frequencies_hz) for m in (one, other))
    assert np.std(10.0 * np.log10(np.divide(*spectra))) < 1.5
    assert found.start_s == usual.start_s


def test_frames_of_another_number_of_samples_are_refused():
    with pytest.raises(InputError, match="2 samples of the acceleration, the settings say"):
        StreamFilter().process(stroked(textured(20, 2)))


def model_of(rate_hz):
    shipped = mmt.load_model("oak")
    return TextureModel(shipped.samples, method="published", rate_hz=rate_hz)


@pytest.mark.parametrize("rate_hz", [500.0, 2000.0])
async def test_every_way_into_a_session_resamples_a_model_of_another_rate(rate_hz, tmp_path):
    model = model_of(rate_hz)
    file = tmp_path / "other.npz"
    model.save(file)
    scene = scene_from_tables(
        {
            "hand": {},
            "link": {},
            "simulated": {},
            "texture": {},
            "actuator": {},
            "rendering": {"model": str(file)},
        }
    )
    told = []
    session = Session(scene, told.append)
    saved, shared = (build_parts(session, ["synthesizing"]).synthesizing for _ in range(2))
    assert saved is not None
    shared.synthesizer.model = None
    ModelOutput(session, synthesizing=saved).begin()
    await ModelOutput(session, synthesizing=shared).use_shared(model, None)
    what = "nothing above 250 Hz is in it" if rate_hz < 1000 else "what is above 500 Hz is left out"
    assert told == [f"the model is of {rate_hz:g} Hz and is played at 1000 Hz: {what}"] * 2
    below_hz = np.arange(20.0, 0.4 * min(rate_hz, 1000.0))
    wanted = model.spectrum(120.0, 1.0, frequencies_hz=below_hz)
    for part in (saved, shared):
        assert part.synthesizer.model.rate_hz == 1000.0
        played = part.synthesizer.model.spectrum(120.0, 1.0, frequencies_hz=below_hz)
        assert np.sqrt(np.mean((10.0 * np.log10(played / wanted)) ** 2)) < 2.0


def test_frames_stamped_at_another_rate_are_refused():
    frames, truth = mmt.simulate_session(mmt.Scene(), surface="wood", duration_s=3.0)
    mmt.build_model(frames)
    slow = frames.copy()
    slow["time_ns"] = slow["time_ns"][0] + 2 * (frames["time_ns"] - frames["time_ns"][0])
    for use in (
        lambda: mmt.build_model(slow, mmt.ModellingSettings()),
        lambda: mmt.evaluate_session(mmt.RecordedSession(slow, annotations=truth)),
    ):
        with pytest.raises(InputError, match="500 Hz"):
            use()
    jittered = frames.copy()
    jitter_ns = np.random.default_rng(1).integers(-400_000, 400_000, len(frames))
    jittered["time_ns"] += jitter_ns
    mmt.build_model(jittered)
