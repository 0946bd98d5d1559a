"""The first start, on a machine that has compiled nothing yet."""

from pathlib import Path

from service_processes import scene, session

import mmt


def test_a_first_session_begins_before_modelling_is_compiled_and_is_modelled_whole(
    tmp_path: Path,
) -> None:
    cache, recording = tmp_path / "cache", tmp_path / "session.mcap"
    arguments = ("--duration", 4, "--record", recording)
    with session(tmp_path, "demo", *arguments, NUMBA_CACHE_DIR=str(cache)) as (leader, follower):
        compiled = set(cache.rglob("*.nbi"))
        assert (leader.end(150.0), follower.end()) == (0, 0)
    assert compiled < set(cache.rglob("*.nbi"))
    assert any(event.startswith("modelling begins") for event in leader.events())
    texture, recorded = leader.summary()["texture"], mmt.read_session(recording)
    assert texture["dropped_frames"] == texture["late_frames"] == 0
    table = mmt.load_scene(Path(scene("demo"))).texture
    assert table is not None
    history = mmt.build_model(recorded.frames, table.settings(1000.0), table.update_period_s)
    time_s, model = recorded.models[-1]
    expected = history.model_at(time_s)
    assert expected is not None
    assert texture["updates"] == len(recorded.frames) // 1000
    assert model == expected.to_bytes()
