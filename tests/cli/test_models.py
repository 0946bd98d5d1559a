"""`mmt model`: the command line that builds texture models and looks at them."""

import numpy as np
import pytest
from command_runs import output_of, refusal, run_json
from surface_courses import glass_and_sandpaper, stroked_over

from mmt.core.errors import MmtError
from mmt.core.frames import empty_frames
from mmt.scene import Scene, Texture
from mmt.session.files import read_session, write_session
from mmt.testing.simulation.offline import simulate_session
from mmt.texture.completion.distance import distance_sum
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.online.history import trials
from mmt.texture.online.modeller import OnlineModeller
from mmt.texture.segmentation.bottom_up import CELL
from mmt.texture.settings import ModellingSettings

DURATION_S = 12.0


@pytest.fixture(scope="module")
def session_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("models") / "wood.npz"
    frames, annotations = simulate_session(Scene(), "wood", DURATION_S, 3)
    write_session(path, frames, annotations=annotations)
    return path


BUILD, INFO = ("model", "build"), ("model", "info")


def test_of_several_surfaces_one_is_chosen(tmp_path):
    frames, annotations = stroked_over(glass_and_sandpaper(), DURATION_S)
    session = tmp_path / "two.npz"
    write_session(session, frames, annotations=annotations)
    scene = tmp_path / "scene.toml"
    scene.write_text("[link]\n[replay]\n[texture.surfaces]\n", encoding="utf-8")
    build = (*BUILD, session, tmp_path / "model.npz", "--scene", scene)
    said = refusal(*build)
    assert "over the surfaces 1, 2; choose one with --surface" in said
    powers = []
    for surface in (1, 2):
        output_of(*build, "--surface", surface, "--force")
        powers.append(float(TextureModel.load(tmp_path / "model.npz").samples.power.mean()))
    assert powers[1] > 30 * powers[0]  # sandpaper's over glass's
    without_scene = (*BUILD, session, tmp_path / "other.npz", "--surface", 1)
    assert "all is one surface" in refusal(*without_scene)


def test_the_model_is_that_of_the_live_leader_at_the_stop_criterion_and_goes_on_with_whole(
    session_file, tmp_path
):
    figures, _ = run_json(tmp_path, *BUILD, session_file, tmp_path / "wood.npz")
    modeller = OnlineModeller()
    frames = read_session(session_file).frames
    updates = (modeller.update(frames[n : n + 1000]) for n in range(0, len(frames), 1000))
    update = next(update for update in updates if update.stopped)
    saved = TextureModel.load(tmp_path / "wood.npz")
    np.testing.assert_array_equal(saved.samples.lsf, update.model.samples.lsf)
    np.testing.assert_array_equal(saved.samples.power, update.model.samples.power)
    assert figures["stop_s"] == update.time_s
    assert figures["samples"] == update.samples
    assert figures["distance"] == pytest.approx(update.distance, abs=1e-3)
    output_of(*BUILD, session_file, tmp_path / "end.npz", "--whole")
    whole = TextureModel.load(tmp_path / "end.npz")
    assert len(whole.samples) > len(saved.samples)
    assert distance_sum(whole.points) < distance_sum(saved.points)


def test_several_sessions_give_one_model(session_file, tmp_path):
    second = tmp_path / "second.npz"
    frames, annotations = simulate_session(Scene(), "wood", 6.0, 5)
    write_session(second, frames, annotations=annotations)
    counts = []
    for sources in ([session_file, "--whole"], [second, "--whole"], [session_file, second]):
        target = tmp_path / f"{len(counts)}.npz"
        figures, _ = run_json(tmp_path, *BUILD, *sources, target)
        counts.append(len(TextureModel.load(target).samples))
    assert counts[2] == pytest.approx(counts[0] + counts[1], abs=4)
    assert counts[2] > max(counts[:2])
    assert figures["sessions"] == [str(session_file), str(second)]


def test_no_segment_spans_two_sessions():
    frames, _ = simulate_session(Scene(), "wood", 3.0, 3)
    wrapped = frames[500:2999].copy()
    wrapped["sequence"] += 2**32 - 2000
    blocks = trials([frames, wrapped, frames])
    joined = np.concatenate([block["sequence"] for block in blocks]).astype(np.int64)
    steps = np.diff(joined)
    assert all(block["sequence"][0] % CELL == 0 for block in blocks)
    edges = joined[:-1][steps > 1] + 1
    assert len(edges) == 2
    modeller = OnlineModeller(ModellingSettings(longest_bridged_samples=10))
    for block in blocks:
        assert modeller.update(block).faults.bridged_s == 0.0
    assert len(modeller.fits) > 6
    for start, stop in modeller.fits:
        assert not any(start <= edge < stop for edge in edges)


def test_a_scene_says_how_to_model(session_file, tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text("[link]\n[replay]\n[texture]\norder = 9\nmethod = 'published'\n", "utf-8")
    output_of(*BUILD, session_file, tmp_path / "m.npz", "--scene", scene)
    model = TextureModel.load(tmp_path / "m.npz")
    assert (model.order, model.method) == (9, "published")
    assert Texture().settings().filter_order == 16


def test_info_says_what_the_file_holds(session_file, tmp_path):
    target = tmp_path / "new folder" / "m.npz"
    output_of(*BUILD, session_file, target)
    figures, result = run_json(tmp_path, *INFO, target)
    samples = TextureModel.load(target).samples
    assert figures["samples"] == len(samples)
    assert figures["order"] == samples.lsf.shape[1]
    assert figures["speed_mm_s"]["most"] == pytest.approx(samples.speed_mm_s.max(), abs=0.05)
    assert figures["rms_m_s2"]["least"] == pytest.approx(samples.power.min() ** 0.5, abs=1e-4)
    assert str(len(samples)) in result.output
    assert "m.npz/n.npz" in refusal(*BUILD, session_file, target / "n.npz")


def test_a_hand_that_never_strokes_gives_no_model(tmp_path):
    frames = empty_frames(3000)
    frames["sequence"] = np.arange(3000)
    frames["time_ns"] = np.arange(3000) * 1_000_000
    write_session(tmp_path / "still.npz", frames)
    said = refusal(*BUILD, tmp_path / "still.npz", tmp_path / "m.npz", kind=MmtError)
    assert "never stroked" in said
    assert not (tmp_path / "m.npz").exists()


def test_a_model_has_the_rate_of_its_recordings(session_file, tmp_path):
    scene = Scene.model_validate({"session": {"acceleration_rate_hz": 5000}})
    frames, truth = simulate_session(scene, surface="plastic", duration_s=6.0, seed=1)
    fast = tmp_path / "fast.mcap"
    write_session(fast, frames, annotations=truth)
    output_of(*BUILD, fast, tmp_path / "m.npz")
    assert TextureModel.load(tmp_path / "m.npz").rate_hz == 5000.0
    said = refusal(*BUILD, fast, session_file, tmp_path / "both.npz")
    assert "at 5 kHz" in said
    assert "at 1 kHz: import them at one rate" in said
