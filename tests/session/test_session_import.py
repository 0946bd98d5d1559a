"""Other people's recordings become frames at 1 kHz, or an error that names the place."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.core.errors import InputError
from mmt.session.files import import_session, read_session, write_session

SHARED = Path(__file__).parents[2] / ".." / "shared" / "data" / "bilateral_1dof"


def tone(time_s, frequency_hz):
    """Three axes of one tone, offset as position and gravity are; shape (n, 3)."""
    phases = np.array([0.0, 1.0, 2.0])
    return 5.0 + np.sin(2 * np.pi * frequency_hz * np.asarray(time_s)[:, None] + phases)


def save(path, time_s, **arrays):
    np.savez(path, time_s=time_s, **arrays)
    return path


def grid_s(frames):
    return frames["sequence"] / 1000.0


@pytest.mark.parametrize("rate_hz", [250, 333, 500, 800, 995, 1005, 1600, 2000, 3333, 10_000])
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


@pytest.mark.parametrize("frequency_hz", [50, 200, 400, 520, 700, 1300, 1900, 4700])
def test_what_fits_passes_unchanged_and_what_is_too_fast_does_not_fold_back(tmp_path, frequency_hz):
    time_s = np.arange(20_000) / 10_000
    path = save(tmp_path / "fast.npz", time_s, acceleration_m_s2=tone(time_s, frequency_hz))
    frames = import_session(path).frames[40:-40]
    fits = frequency_hz < 500
    expected, atol = (tone(grid_s(frames), frequency_hz), 0.012) if fits else (5.0, 3e-4)
    np.testing.assert_allclose(frames["acceleration_m_s2"], expected, atol=atol)


def test_acceleration_may_have_its_own_rate(tmp_path):
    slow_s = np.arange(1000) / 500
    fast_s = 0.1 + np.arange(20_000) / 10_000
    path = save(
        tmp_path / "two.npz",
        slow_s,
        position_mm=tone(slow_s, 2),
        force_n=tone(slow_s, 3),
        acceleration_time_s=fast_s,
        acceleration_m_s2=tone(fast_s, 150),
    )
    session = import_session(path)
    frames = session.frames
    assert session.channels == ("position", "force", "acceleration")
    # Only where all channels are known.
    assert (frames["sequence"][0], frames["sequence"][-1]) == (100, 1998)
    inner = frames[40:-40]
    np.testing.assert_allclose(inner["position_mm"], tone(grid_s(inner), 2), atol=1e-3)
    np.testing.assert_allclose(inner["force_n"], tone(grid_s(inner), 3), atol=1e-3)
    np.testing.assert_allclose(inner["acceleration_m_s2"], tone(grid_s(inner), 150), atol=2e-3)


@pytest.mark.parametrize(("longest_gap_s", "missing"), [(None, True), (0.3, False), (0.1, True)])
def test_a_gap_in_time_becomes_a_gap_in_sequence(tmp_path, longest_gap_s, missing):
    time_s = np.concatenate([np.arange(600), np.arange(1000, 2000)]) / 2000.0
    path = save(tmp_path / "gap.npz", time_s, position_mm=tone(time_s, 1))
    sequence = import_session(path, longest_gap_s=longest_gap_s).frames["sequence"].astype(int)
    inside = (sequence > 299) & (sequence < 500)
    assert bool(inside.sum() == 0) is missing
    assert {299, 500} <= set(sequence.tolist())


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


def test_text_columns_may_end_early_where_rates_differ(tmp_path):
    slow_s, fast_s = np.arange(500) / 500, np.arange(2000) / 2000
    lines = [
        "time_s,force_x_n,force_y_n,force_z_n,acceleration_time_s,"
        "acceleration_x_m_s2,acceleration_y_m_s2,acceleration_z_m_s2"
    ]
    for row, time_s in enumerate(fast_s):
        slow = f"{slow_s[row]},1,2,3" if row < len(slow_s) else ",,,"
        lines.append(f"{slow},{time_s},4,5,6")
    path = tmp_path / "two.csv"
    path.write_text("\n".join(lines))
    frames = import_session(path).frames
    assert len(frames) == 999
    np.testing.assert_allclose(frames["force_n"], [[1, 2, 3]] * 999, rtol=1e-6)
    np.testing.assert_allclose(frames["acceleration_m_s2"], [[4, 5, 6]] * 999, rtol=1e-6)


HEADER = "time_s,force_x_n,force_y_n,force_z_n\n"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "the file is empty"),
        (HEADER, "force has 0 rows, at least 2"),
        (HEADER + "0,1,1,1\n0.001,1,oops,1\n", "force_y_n is 'oops' in line 3"),
        (HEADER + "0,1,1,1\n0.002,1,1,1\n0.001,1,1,1\n", "time of force is 0.001 s in line 4"),
        (HEADER + "0,1,1,1\n0.001,1,nan,1\n", "force_y is empty or NaN in line 3"),
        (HEADER + "0,1,1,1\n0.001,,1,1\n0.002,1,1,1\n", "force_x is empty or NaN in line 3"),
        (HEADER + "0,1,1,1\n.1,1,1,1\n.2,1,1\n.3,1,1\n", "force end in different rows: 2, 4"),
        ("\x00\x01\x02", "not text in columns"),
    ],
)
def test_text_that_is_wrong_is_named(tmp_path, text, reason):
    (tmp_path / "wrong.csv").write_text(text)
    with pytest.raises(InputError, match=reason):
        import_session(tmp_path / "wrong.csv")


def test_files_of_another_kind_are_refused(tmp_path):
    (tmp_path / "a.npz").write_bytes(b"")
    (tmp_path / "b.npz").write_bytes(b"not an archive")
    (tmp_path / "c.csv").write_bytes(b"\x00\x01\x02\x03")
    with (tmp_path / "d.npz").open("wb") as stream:
        np.save(stream, np.zeros(3))
    np.savez(tmp_path / "e.npz", time_s=np.array([{}]), force_n=np.ones((1, 3)))
    for name in "a.npz", "b.npz", "c.csv", "d.npz", "e.npz":
        with pytest.raises(InputError, match="this is"):
            import_session(tmp_path / name)
    for name in "absent.npz", "absent.csv", "absent":
        with pytest.raises(InputError, match="No such file"):
            import_session(tmp_path / name)
    with pytest.raises(InputError, match=r"\.mp3 cannot be read.*\.csv.*\.npz"):
        import_session(tmp_path / "run.mp3")
    with pytest.raises(InputError, match="longest_gap_s is 0"):
        import_session(tmp_path / "a.npz", longest_gap_s=0)


def test_real_recordings_are_imported_and_kept(tmp_path):
    """2 kHz runs of a real teleoperator, its lever's tip as x and its force as z."""
    if not SHARED.is_dir():
        pytest.skip("the recorded data is not in ../shared/data")
    with np.load(SHARED / "question1a_rigid.npz") as run:
        time_s = run["time_s"]
        arm_mm = 1000 * float(run["arm_length_m"])
        travel = arm_mm * run["follower_position_rad"].astype(float)
        force = 1000 * run["environment_torque_nm"].astype(float) / arm_mm
    nothing = np.zeros_like(travel)
    path = save(
        tmp_path / "rigid.npz",
        time_s,
        position_mm=np.column_stack([travel, nothing, nothing]),
        force_n=np.column_stack([nothing, nothing, force]),
    )
    session = import_session(path)
    frames = session.frames
    assert len(frames) == pytest.approx((time_s[-1] - time_s[0]) * 1000, abs=2)
    at_frames = np.interp(grid_s(frames), time_s - time_s[0], travel)
    assert np.abs(frames["position_mm"][:, 0] - at_frames).max() < 0.02 * np.ptp(travel)
    write_session(tmp_path / "rigid.mcap", frames)
    np.testing.assert_array_equal(read_session(tmp_path / "rigid.mcap").frames, frames)
