"""``mmt session inspect`` proposes the command that imports a stranger's file."""

import shlex

import numpy as np
import pytest
from command_runs import output_of, refusal, run, run_json

from mmt.session.files import read_session

TIME_S = np.arange(3000) / 1000
POSITION_MM = np.column_stack([30 * np.sin(5 * TIME_S), 10 * TIME_S])
FORCE_N = 1 + 0.5 * np.sin(2 * TIME_S)
ACCELERATION_M_S2 = np.random.default_rng(1).standard_normal(3000) + 9.81

FILES = {
    "lab.csv": "Time [ms],Tip X (mm),Tip Y (mm),Fz [mN],acc_z_g\n",
    "long.csv": "timestamp_ms,pos_x,pos_y,force_z_mn,accelZ [g]\n",
    "german.csv": "Lauf 3\nZeit;x;y;Fz;az\nms;mm;mm;mN;g\n",
    "short.csv": "t,px,py,fz_mN,az_g\n",
}


IMPORT, INSPECT = ("session", "import"), ("session", "inspect")


@pytest.mark.parametrize("name", FILES)
def test_the_proposed_command_imports_the_file(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    delimiter = ";" if "german" in name else ","
    columns = [1e3 * TIME_S, *POSITION_MM.T, 1e3 * FORCE_N, ACCELERATION_M_S2 / 9.80665]
    rows = [delimiter.join(f"{value:.6f}" for value in row) for row in np.column_stack(columns)]
    (tmp_path / name).write_text(FILES[name] + "\n".join(rows))
    told = run(*INSPECT, name)
    assert told.exit_code == 0, told.output
    command = shlex.split(told.stdout.splitlines()[-1])
    assert command[:4] == ["mmt", *IMPORT, name]
    output_of(*command[1:])
    frames = read_session(tmp_path / command[4]).frames
    np.testing.assert_allclose(frames["position_mm"][:, :2], POSITION_MM, atol=1e-3)
    np.testing.assert_allclose(frames["force_n"][:, 2], FORCE_N, atol=1e-3)
    np.testing.assert_allclose(frames["acceleration_m_s2"][:, 2], ACCELERATION_M_S2, atol=1e-3)


def test_a_file_of_which_nothing_is_known_is_listed(tmp_path):
    (tmp_path / "odd.csv").write_text("alpha,beta\n1,2\n2,3\n")
    told = output_of(*INSPECT, tmp_path / "odd.csv")
    assert "must have the form NAME=VALUE" in refusal(
        *(*IMPORT, tmp_path / "odd.csv", tmp_path / "a.mcap", "--map", "force")
    )
    assert not (tmp_path / "a.mcap").exists()
    assert "columns: alpha, beta" in told
    assert "no column was found for time: --map time=NAME, or --rate HZ" in told
    assert "no name tells a channel: say which columns are" in told


@pytest.mark.parametrize(
    ("header", "note"),
    [
        ("alpha,alpha", "2 columns are called alpha"),
        ("t,Fz", "1 lines of text were left out, the first is line 4"),
    ],
)
def test_what_a_file_holds_beside_is_told_though_it_cannot_be_imported(tmp_path, header, note):
    (tmp_path / "odd.csv").write_text(f"{header}\n1,2\n1,3\nno sensor\n1,4\n1,5\n")
    told = run(*INSPECT, tmp_path / "odd.csv")
    assert f"look: {note}" in told.output


def test_import_prints_and_writes_what_it_found(tmp_path):
    force_n = np.column_stack([0 * TIME_S, 0 * TIME_S, -FORCE_N])
    np.savez(tmp_path / "a.npz", time_s=TIME_S, force_n=force_n)
    files = (tmp_path / "a.npz", tmp_path / "a.mcap")
    found, done = run_json(tmp_path, *IMPORT, *files)
    assert "force_z_n" in done.output
    assert "--map force=-force_n" in done.output
    assert found["frames"] == 3000
    assert found["channels"][0]["rate_hz"] == pytest.approx(1000)
    assert len(found["warnings"]) == 1
    mended = run(*IMPORT, *files, "--map", "force=-force_n", "--force")
    assert "--map force=" not in mended.output
