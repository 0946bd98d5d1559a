"""Recordings as the programs of a laboratory write them come in as proposed, with right values."""

import numpy as np
import pytest

from mmt.core.errors import InputError
from mmt.session.importing.proposal import propose, try_proposal
from mmt.session.importing.recording import import_recording

pytestmark = pytest.mark.usefixtures("read_here")

TIME_S = np.arange(0.0, 2.0, 0.001)
"""Times of the rows of every file here, but those of tables with several sensors."""


def motion(time_s):
    return np.column_stack([40 * np.sin(4.4 * time_s), 2 * time_s, 5 * np.cos(3 * time_s)])


def force(time_s):
    return np.column_stack([0.3 * np.cos(4.4 * time_s), 0 * time_s, 1.5 + np.sin(1.9 * time_s)])


def vibration(time_s):
    return np.column_stack(
        [2 * np.sin(90 * time_s), 3 * np.cos(70 * time_s), 9.8 + np.sin(80 * time_s)]
    )


TRUTH = {"position": motion, "force": force, "acceleration": vibration}
FIELDS = {"position": "position_mm", "force": "force_n", "acceleration": "acceleration_m_s2"}


def lines(path, head, rows, sign=","):
    path.write_text("\n".join([head, *(sign.join(map(str, row)) for row in rows)]) + "\n")


def imported(path):
    """Import a file with the options that are proposed for it."""
    proposal, _, error = try_proposal(path, propose(path))
    assert error is None
    return import_recording(path, proposal.options)[0]


def with_units(path):
    rows = zip(TIME_S, force(TIME_S), motion(TIME_S), strict=True)
    cells = ([f"{t:.3f} s", *(f"{f:.6f}N" for f in fs), *(f"{p:.4f} mm" for p in ps)]
             for t, fs, ps in rows)  # fmt: skip
    lines(path, "time;Fx;Fy;Fz;px;py;pz", cells, ";")


def in_hexadecimals(path):
    counts = np.rint(1000 * vibration(TIME_S)).astype(int)
    cells = ([f"0x{round(1e6 * t):08X}", *(f"0x{c & 0xFFFF:04x}" for c in row)]
             for t, row in zip(TIME_S, counts.tolist(), strict=True))  # fmt: skip
    lines(path, "t_us,ax_mm_s2,ay_mm_s2,az_mm_s2", cells)


KINDS = {
    "units.csv": (with_units, {"position", "force"}),
    "hex.csv": (in_hexadecimals, {"acceleration"}),
}


@pytest.mark.parametrize("name", KINDS)
def test_a_recording_comes_in_as_it_was_made(tmp_path, name):
    make, channels = KINDS[name]
    make(tmp_path / name)
    session = imported(tmp_path / name)
    time_s = session.frames["time_ns"] / 1e9
    assert set(session.channels) == channels
    assert len(time_s) == pytest.approx(len(TIME_S), abs=5)
    for channel in channels:
        found = session.frames[FIELDS[channel]].reshape(-1, 3)
        np.testing.assert_allclose(found, TRUTH[channel](time_s), atol=2e-3)


def of_two_units(path):
    lines(path, "time,Fz", [(f"{t:.3f}", "7 mN" if t > 1 else "1.5 N") for t in TIME_S])


REFUSED = {
    "two units.csv": (of_two_units, r"Fz are written with N or with mN"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_recording_that_cannot_be_read_right_is_refused(tmp_path, name):
    make, reason = REFUSED[name]
    make(tmp_path / name)
    with pytest.raises(InputError, match=reason):
        imported(tmp_path / name)
