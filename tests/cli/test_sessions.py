"""``mmt session``: trials, what was no measurement, data sets, strangers' files, the view."""

import asyncio
import shlex
import socket

import aiohttp
import numpy as np
import pytest
from command_runs import output_of, run, run_json
from frame_samples import made_frames
from recording_server import serving

from mmt.core.errors import MmtError
from mmt.scene import Scene
from mmt.session.data import RecordedSession
from mmt.session.files import read_session, write_session
from mmt.session.windows import MemoryWindows
from mmt.testing.simulation.offline import simulate_session
from mmt.testing.simulation.surfaces.textures import surface_from_annotations
from mmt.web.viewing.recording import ViewedRecording
from mmt.web.viewing.server import serve_recording


def simulate(*options):
    output_of("session", "simulate", *options, "--duration", 0.5, "--surface", "oak")


def test_trials_are_numbered_sessions_of_seeds_in_a_row(tmp_path):
    simulate(tmp_path / "oak.mcap", "--trials", 10, "--seed", 5)
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == [f"oak-{number:02}.mcap" for number in range(1, 11)]
    simulate(tmp_path / "single.mcap", "--seed", 7)
    single = read_session(tmp_path / "single.mcap")
    trials = [read_session(tmp_path / name) for name in names[1:3]]
    np.testing.assert_array_equal(trials[1].frames, single.frames)
    assert (trials[0].frames["acceleration_m_s2"] != single.frames["acceleration_m_s2"]).any()
    assert surface_from_annotations(single.annotations).name == "oak"


def test_info_says_that_the_accelerometer_was_dead(tmp_path):
    simulate(tmp_path / "oak.mcap")
    frames = read_session(tmp_path / "oak.mcap").frames.copy()
    found, result = run_json(tmp_path, "session", "info", tmp_path / "oak.mcap")
    assert "not measured" not in result.output
    assert found["faults"]["text"] == ""
    frames["acceleration_m_s2"] = 9.81
    frames["position_mm"][:, 0] = 0.1 * frames["sequence"]
    frames["force_n"][:, 2] = 1.0
    write_session(tmp_path / "dead.mcap", frames)
    said = "the accelerometer gave one value throughout"
    found, result = run_json(tmp_path, "session", "info", tmp_path / "dead.mcap")
    assert f"not measured: {said}" in result.output
    assert found["faults"]["text"] == said
    # what waits for its motion has not left the filter
    assert 0.4 < found["faults"]["constant_s"] <= 0.5


def test_several_sessions_become_episodes_and_come_back_to_the_bit(tmp_path):
    pytest.importorskip("pyarrow", reason="needs the extra 'export'")
    files, folder = [tmp_path / "a.mcap", tmp_path / "b.mcap"], tmp_path / "set"
    for seed, file in enumerate(files, start=1):
        frames, truth = simulate_session(Scene(), "oak", 0.5, seed)
        write_session(file, frames, annotations=truth)
    options = ("--to", "lerobot", "--fps", 30, "--task", "stroke oak")
    said = output_of("session", "export", *files, folder, *options)
    assert "30 rows in 2 episodes written to" in " ".join(said.split())
    output_of("session", "import", folder, tmp_path / "back.mcap", "--episode", 1)
    back, original = read_session(tmp_path / "back.mcap"), read_session(files[1])
    np.testing.assert_array_equal(back.frames, original.frames)
    assert back.annotations == original.annotations


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


def recording():
    return ViewedRecording(MemoryWindows(RecordedSession(made_frames(0, 500))))


async def test_a_port_that_is_taken():
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(MmtError, match=f"port {port} .*: set --port to"):
            await serve_recording(recording(), port, asyncio.Event(), print)


async def test_what_is_asked_wrongly_is_refused():
    async with serving(recording()) as url, aiohttp.ClientSession() as client:

        async def status(path, **headers):
            async with client.get(url + path, headers=headers) as answer:
                return answer.status

        assert await status("moment?time_s=0.2") == 200
        assert await status("moment?time_s=1e300") == 200  # which is the end
        assert await status("moment?time_s=nan") == 400
        assert await status("moment") == 400
        assert await status("model?number=1e999") == 400
        assert await status("model?number=-1") == 404
        assert await status("nothing.js") == 404
        # another site's page, and another site's name for this machine
        assert await status("opening", Origin="http://elsewhere.example") == 403
        assert await status("opening", Host="elsewhere.example") == 403
