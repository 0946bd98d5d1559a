"""The layout of frames, and which frames, rates and channels fit."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmt.core import frames as f
from mmt.core.errors import InputError

FRAMES = f.empty_frames(4)


@given(st.lists(st.sampled_from(f.ALL_CHANNELS), min_size=1), st.integers(1, 10))
def test_a_frame_is_packed_in_its_layout(channels, count):
    frames = f.empty_frames(2, channels, count)
    wanted = tuple(channel for channel in f.ALL_CHANNELS if channel in channels)
    assert f.channels_of(frames.dtype) == f.ordered_channels(channels) == wanted
    fields = [f.FIELD_OF_CHANNEL[channel] for channel in wanted]
    assert frames.dtype.names == ("sequence", "time_ns", *fields)
    size = sum({"acceleration": 3 * count, "orientation": 4}.get(name, 3) for name in wanted)
    packed = f.frame_struct(frames.dtype).pack(7, -5, *range(size))
    frames[1] = np.frombuffer(packed, frames.dtype)[0]
    assert frames[1].tolist()[:2] == (7, -5)
    assert np.concatenate([frames[name][1].ravel() for name in fields]).tolist() == [*range(size)]
    sampled = "acceleration" in wanted
    assert f.samples_per_frame(frames.dtype) == (count if sampled else 1)
    assert not sampled or frames.dtype["acceleration_m_s2"].shape == (count, 3)[count == 1 :]
    assert not sampled or f.acceleration_samples(frames).shape == (2 * count, 3)


def test_a_usual_frame_has_one_sample_and_axes_have_names():
    assert f.samples_per_frame(FRAMES.dtype) == f.samples_per_frame(f.frame_dtype()) == 1
    assert [f.axes_of(channel) for channel in ("force", "orientation")] == ["xyz", "wxyz"]


@pytest.mark.parametrize(
    "frames", [None, [1], np.zeros(3), FRAMES[0], FRAMES.reshape(2, 2), FRAMES[["time_ns"]]]
)
def test_what_are_no_frames_or_lack_a_channel_is_refused(frames):
    with pytest.raises(InputError, match="is needed"):
        f.check_frames(frames)
    with pytest.raises(InputError, match=r"^frames without force, acceleration: position, f"):
        f.check_frames(f.empty_frames(0, ["position"]))


def test_what_is_no_channel_or_no_rate_of_samples_is_refused():
    for channels, told in ((["taste", "force", "smell"], "smell, taste"), ([], "none")):
        with pytest.raises(InputError, match=f"^channels: {told} given, allowed are position, f"):
            f.ordered_channels(channels)
    for rate_hz in (1000, 5000, 10_000):
        f.check_acceleration_rate(rate_hz)
    for rate_hz in (0, 999, 1500, 11_000):
        with pytest.raises(InputError, match=f"--acceleration-rate {rate_hz}: .* 1000, to 10000$"):
            f.check_acceleration_rate(rate_hz)


@pytest.mark.parametrize(
    ("rate_hz", "fits"), [(890, False), (910, True), (1090, True), (1120, False)]
)
def test_frames_fit_that_are_a_period_apart_whatever_is_lost(rate_hz, fits):
    frames = f.empty_frames(9)
    frames["sequence"] = [0, 1, 2, 100, 200, 300, 400, 500, 501]
    frames["time_ns"] = frames["sequence"] * (1e9 / rate_hz)
    f.check_frame_rate(frames[2:-1], 1000.0)
    if fits:
        f.check_frame_rate(frames, 1000.0)
        return
    told = f"^the frames are {1e3 / rate_hz:g} ms apart .*, which is {rate_hz} Hz: 1000 Hz"
    with pytest.raises(InputError, match=told):
        f.check_frame_rate(frames, 1000.0)


@pytest.mark.parametrize(
    ("rate_hz", "samples_hz", "lacks"),
    [(2000.0, 5000.0, True), (1900.0, 2000.0, False), (4000.0, 2000.0, False)],
)
def test_what_a_slow_sensor_lacks_is_said(rate_hz, samples_hz, lacks):
    assert ("nothing above 1000 Hz" in f.missing_band(rate_hz, samples_hz)) == lacks
    assert bool(f.missing_band(rate_hz, samples_hz)) == lacks
