"""Other people's recordings become frames at 1 kHz, or an error that names the place."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.core.errors import InputError
from mmt.session.files import import_session


def tone(time_s, frequency_hz):
    """Three axes of one tone, offset as position and gravity are; shape (n, 3)."""
    phases = np.array([0.0, 1.0, 2.0])
    return 5.0 + np.sin(2 * np.pi * frequency_hz * np.asarray(time_s)[:, None] + phases)


def save(path, time_s, **arrays):
    np.savez(path, time_s=time_s, **arrays)
    return path


def grid_s(frames):
    return frames["sequence"] / 1000.0


@pytest.mark.parametrize("rate_hz", [250, 333, 800, 995, 1005, 2000, 10_000])
def test_a_tone_keeps_its_values_at_any_rate(tmp_path, rate_hz):
    time_s = 7.0 + np.arange(2 * rate_hz) / rate_hz
    path = save(tmp_path / "other.npz", time_s, position_mm=tone(time_s - 7.0, 20))
    frames = import_session(path).frames
    assert len(frames) == pytest.approx(2000, abs=1000 / rate_hz + 1)
    assert frames["sequence"][0] == 0
    assert np.all(np.diff(frames["sequence"].astype(int)) == 1)
    np.testing.assert_array_equal(np.diff(frames["time_ns"]), 1_000_000)
    inner = frames[40:-40]  # the decimating filter needs 32 ms on either side
    np.testing.assert_allclose(inner["position_mm"], tone(grid_s(inner), 20), atol=2e-3)
    np.testing.assert_allclose(frames["position_mm"], tone(grid_s(frames), 20), atol=0.05)


def test_frames_begin_and_end_where_all_channels_are_known(tmp_path):
    slow_s = np.arange(1000) / 500
    fast_s = 0.1 + np.arange(20_000) / 10_000
    path = save(
        tmp_path / "two.npz",
        slow_s,
        force_n=tone(slow_s, 3),
        acceleration_time_s=fast_s,
        acceleration_m_s2=tone(fast_s, 150),
    )
    frames = import_session(path).frames
    assert (frames["sequence"][0], frames["sequence"][-1]) == (100, 1998)
    inner = frames[40:-40]
    np.testing.assert_allclose(inner["force_n"], tone(grid_s(inner), 3), atol=1e-3)
    np.testing.assert_allclose(inner["acceleration_m_s2"], tone(grid_s(inner), 150), atol=2e-3)


def test_a_gap_in_one_channel_is_a_gap_in_all(tmp_path):
    slow_s = np.arange(500) / 500
    fast_s = np.delete(np.arange(4000), np.r_[1000:2000]) / 4000
    path = save(
        tmp_path / "gap.npz",
        slow_s,
        force_n=tone(slow_s, 1),
        acceleration_time_s=fast_s,
        acceleration_m_s2=tone(fast_s, 1),
    )
    sequence = import_session(path).frames["sequence"].astype(int)
    np.testing.assert_array_equal(sequence, np.r_[:250, 500:999])


@given(
    rate_hz=st.floats(60, 20_000),
    jitter=st.floats(0, 0.4),
    start_s=st.floats(-1e6, 1e6),
    seed=st.integers(0, 100),
)
@settings(max_examples=25)
def test_a_constant_stays_constant(tmp_path_factory, rate_hz, jitter, start_s, seed):
    """Uneven times, any rate, any origin: nothing but the value itself comes out."""
    rng = np.random.default_rng(seed)
    count = int(0.3 * rate_hz) + 2
    time_s = start_s + (np.arange(count) + rng.uniform(0, jitter, count)) / rate_hz
    path = tmp_path_factory.mktemp("constant") / "c.npz"
    frames = import_session(save(path, time_s, force_n=np.full((count, 3), 2.5))).frames
    np.testing.assert_allclose(frames["force_n"], 2.5, rtol=1e-6)
    assert len(frames) == pytest.approx((time_s[-1] - time_s[0]) * 1000, abs=2 + 800 / rate_hz)


HEADER = "time_s,force_x_n,force_y_n,force_z_n"


def test_text_columns_may_end_early_where_rates_differ(tmp_path):
    axes = ",".join(f"acceleration_{axis}_m_s2" for axis in "xyz")
    rows = [f"{HEADER},acceleration_time_s,{axes}"]
    for row in range(2000):
        slow = f"{row / 500},1,2,3" if row < 500 else ",,,"
        rows.append(f"{slow},{row / 2000},4,5,6")
    (tmp_path / "two.csv").write_text("\n".join(rows))
    frames = import_session(tmp_path / "two.csv").frames
    np.testing.assert_allclose(frames["force_n"], [[1, 2, 3]] * 999, rtol=1e-6)
    np.testing.assert_allclose(frames["acceleration_m_s2"], [[4, 5, 6]] * 999, rtol=1e-6)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "the file is empty"),
        (HEADER, "force has 0 rows, at least 2"),
        (HEADER + "\n0,1,1,1\n0.001,1,oops,1", "force_y_n is 'oops' in line 3"),
        (HEADER + "\n0,1,1,1\n0.002,1,1,1\n0.001,1,1,1", "time of force is 0.001 s in line 4"),
        (HEADER + "\n0,1,1,1\n0.001,1,nan,1", "force_y is empty or NaN in line 3"),
        (HEADER + "\n0,1,1,1\n0.001,,1,1\n0.002,1,1,1", "force_x is empty or NaN in line 3"),
        (HEADER + "\n0,1,1,1\n.1,1,1,1\n.2,1,1\n.3,1,1", "force end in different rows: 2, 4"),
        ("\x00\x01\x02", "not text in columns"),
    ],
)
def test_text_that_is_wrong_is_named(tmp_path, text, reason):
    (tmp_path / "wrong.csv").write_text(text)
    with pytest.raises(InputError, match=reason):
        import_session(tmp_path / "wrong.csv")


def test_files_of_another_kind_are_refused(tmp_path):
    (tmp_path / "a.npz").write_bytes(b"not an archive")
    with (tmp_path / "b.npz").open("wb") as stream:
        np.save(stream, np.zeros(3))
    np.savez(tmp_path / "c.npz", time_s=np.array([{}]), force_n=np.ones((1, 3)))
    for name in "a.npz", "b.npz", "c.npz":
        with pytest.raises(InputError, match="this is"):
            import_session(tmp_path / name)
    for name in "absent.npz", "absent.csv", "absent":
        with pytest.raises(InputError, match="No such file"):
            import_session(tmp_path / name)
