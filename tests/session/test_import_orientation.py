"""The orientation of a tool in imported recordings, and what it turns."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from mmt.core.errors import InputError
from mmt.session.data import sample_times
from mmt.session.files import import_session
from mmt.session.importing.proposal import propose, try_proposal

pytestmark = pytest.mark.usefixtures("read_here")

angles = st.lists(st.tuples(*[st.floats(-3.0, 3.0)] * 3), min_size=2, max_size=5)


def path_of(turns, rate_hz, count=300):
    """Return times (n,), and the rotations of a slow turn through some orientations."""
    time_s = np.arange(count) / rate_hz
    keys = Rotation.from_rotvec(np.cumsum(0.2 * np.array(turns), axis=0))
    at_s = np.linspace(0.0, time_s[-1], len(turns))
    return time_s, Slerp(at_s, keys)(time_s)


def columns_of(turns, names, order, *, flips=1, scale=1.0):
    """Return the columns of a quaternion, its sign changing every so many rows."""
    signs = np.where(np.arange(len(turns)) // flips % 2, -scale, scale)
    quaternions = turns.as_quat() * signs[:, None]
    return {
        name: quaternions[:, "xyzw".index(axis)] for name, axis in zip(names, order, strict=True)
    }


def degrees_off(frames, turns):
    found = Rotation.from_quat(np.roll(frames["orientation"], -1, axis=1))
    return np.degrees((found * turns.inv()).magnitude()).max()


def written(folder, name="a.csv", **columns):
    table = np.column_stack(list(columns.values()))
    np.savetxt(folder / name, table, delimiter=",", header=",".join(columns), comments="")
    return folder / name


@pytest.mark.parametrize("rate_hz", [1000.0, 400.0, 2500.0])
@given(
    turns=angles, flips=st.integers(1, 300), order=st.permutations("wxyz"), seed=st.integers(0, 99)
)
@settings(max_examples=10)
def test_columns_in_any_order_of_any_sign_and_rate_are_found_by_their_names(
    tmp_path_factory, rate_hz, turns, flips, order, seed
):
    time_s, path = path_of(turns, rate_hz)
    names = [f"{'q' if seed % 2 else 'quat_'}{axis}" for axis in order]
    columns = columns_of(path, names, order, flips=flips, scale=0.995)
    columns |= dict(zip(("fx", "fy", "fz"), np.ones((3, len(time_s))), strict=True))
    file = written(tmp_path_factory.mktemp("a"), time_s=time_s, **columns)
    proposal, report, error = try_proposal(file, propose(file))
    assert error is None, error
    assert report is not None
    options = proposal.options
    frames = import_session(file, columns=options.columns, units=options.units).frames
    seen_s = 1e-9 * (frames["time_ns"] - frames["time_ns"][0])
    exact = Slerp(time_s, path)(np.clip(seen_s, 0.0, time_s[-1]))
    norms = np.linalg.norm(frames["orientation"].astype(float), axis=1)
    np.testing.assert_allclose(norms, 1.0, atol=1e-6)
    corners = 0.0 if rate_hz == 1000.0 else 0.5  # a spline rounds the corners of the path
    assert degrees_off(frames, exact) < 0.01 + corners


def test_no_array_is_proposed_beside_one_of_the_standard_name(tmp_path):
    time_s, path = path_of([(0.0, 0.0, 0.0), (1.0, 2.0, 0.5)], 1000.0)
    quaternions = np.roll(path.as_quat(), 1, axis=1)
    arrays = {"time_s": time_s, "force_n": np.ones((300, 3)), "q_wxyz": quaternions}
    np.savez(tmp_path / "a.npz", q=quaternions, orientation=quaternions, **arrays)
    assert propose(tmp_path / "a.npz").options.columns == {}
    assert degrees_off(import_session(tmp_path / "a.npz").frames, path) < 0.001
    # a column of one number a row is no orientation, whatever its name
    file = written(tmp_path, time_s=time_s, force_z_n=time_s, orientation=time_s)
    assert import_session(file, columns={"force_x": "0", "force_y": "0"}).channels == ("force",)


@pytest.mark.parametrize("samples", [1, 4])
@given(turns=angles)
@settings(max_examples=10)
def test_what_turned_with_the_tool_is_turned_back(tmp_path_factory, samples, turns):
    time_s, path = path_of(turns, 1000.0)
    random = np.random.default_rng(1)
    force, acceleration = random.normal(size=(300, 3)), random.normal(size=(300 * samples, 3))
    each = Rotation.from_quat(np.repeat(path.as_quat(), samples, axis=0))
    arrays = {
        "sequence": np.arange(300),
        "time_s": time_s,
        "force_n": path.inv().apply(force),
        "acceleration_m_s2": each.inv().apply(acceleration),
        "acceleration_time_s": sample_times(time_s, samples, 1e-3),
        "orientation": np.roll(path.as_quat(), 1, axis=1),
    }
    file = tmp_path_factory.mktemp("a") / "a.npz"
    np.savez(file, **arrays)
    session = import_session(file, tool_axes=("force", "acceleration"))
    np.testing.assert_allclose(session.frames["force_n"], force, atol=1e-5)
    found = session.frames["acceleration_m_s2"].reshape(-1, 3)
    np.testing.assert_allclose(found, acceleration, atol=1e-5)
    note = "force and acceleration were turned from the tool's axes"
    assert session.events[-1]["event"] == note
    as_seen = import_session(file).frames["force_n"]
    np.testing.assert_allclose(as_seen, path.inv().apply(force), atol=1e-5)


def test_turning_needs_what_turns_and_an_orientation(tmp_path):
    np.savez(tmp_path / "a.npz", time_s=np.arange(99) / 1e3, force_n=np.ones((99, 3)))
    with pytest.raises(InputError, match=r"--tool-axes force: there is no orientation; map its"):
        import_session(tmp_path / "a.npz", tool_axes=("force",))
    with pytest.raises(InputError, match=r"--tool-axes acceleration: there is no acceleration"):
        import_session(tmp_path / "a.npz", tool_axes=("acceleration",))
