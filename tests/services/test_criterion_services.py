"""The criterion by uncertainty through both services: what is said, recorded and reported."""

import asyncio
import json
import time

from monitor_messages import unpack
from service_runs import Together, small_scene

from mmt.evaluation.evaluate import evaluate_session
from mmt.evaluation.reports.report import write_report
from mmt.scene import Scene
from mmt.scene.files import scene_from_tables
from mmt.session.files import read_session, write_session
from mmt.testing.simulation.offline import simulate_session
from mmt.web.viewing.recording import ViewedRecording

FIELD = {"method": "field", "start_share": 0.5, "stop_share": 0.9}


async def test_a_session_starts_and_stops_by_the_expected_share(tmp_path):
    frames, annotations = simulate_session(Scene(), "fabric", 7.0, 4)
    session = tmp_path / "strokes.npz"
    write_session(session, frames, annotations=annotations)
    recording = tmp_path / "session.mcap"
    scene = small_scene(
        tmp_path,
        simulated=None,
        hand=None,
        replay={"file": str(session), "speed": 2.0},
        texture=FIELD,
        recording={"file": str(recording)},
    )
    together = await Together.listening(scene)
    await together.follow()
    summary = await together.end()

    said = summary.texture["completion"]
    assert said["criterion"] == "uncertainty"
    assert 0.9 <= said["value"] <= 1.0
    assert summary.texture["start_s"] <= summary.texture["stop_s"] < 7.0
    status = together.leader.status()
    assert status.completion == str(together.leader.log.update.progress)
    assert any("stop criterion met" in line for line in together.said)

    seen = ViewedRecording.open(recording)
    seen.start()
    try:
        deadline = time.monotonic() + 60.0
        while not unpack(seen.growth())["done"] and time.monotonic() < deadline:
            await asyncio.sleep(0.02)
        assert unpack(seen.opening())["criterion"]["title"] == "expected share"
        course = unpack(seen.growth())["arrays"]["value"]
        assert ((course >= 0.0) & (course <= 1.0)).all()
        last = unpack(seen.state_at(1e9))["completion"]
        assert last["value"] >= 0.9
        assert (len(last["cells"]), last["advice"]) == (9, None)
    finally:
        seen.close()

    found = read_session(recording)
    recorded = scene_from_tables(dict(found.scene or {}), origin="recorded").texture
    evaluation = evaluate_session(found, recorded.settings())
    assert evaluation.stop_s is not None
    assert evaluation.at_stop.completion >= 0.9
    write_report(tmp_path / "report", [evaluation])
    text = (tmp_path / "report" / "report.md").read_text()
    assert "xpected share" in text
    assert "share of the operator's strokes" in text
    steps = json.loads((tmp_path / "report" / "summary.json").read_text())["steps"]
    assert all(0.0 <= step["completion"] <= 1.0 for step in steps)
