"""A leader that learns a surface's touch-downs, and renders them at those of its own hand."""

import numpy as np
from service_runs import MadeSource, Together, small_scene

import mmt

K = 5
SAMPLES = 50 * K
LEARNT_FRAMES = 8000


async def test_a_leader_renders_what_it_has_learnt_where_its_hand_meets_the_surface(tmp_path):
    scene = small_scene(
        tmp_path,
        session={"acceleration_rate_hz": 1000 * K, "seed": 2, "duration_s": 60.0},
        simulated={"surface": "wood", "surface_stiffness_n_mm": 20.0},
        hand={"kind": "taps"},
        texture={"start_share": 0.2, "stop_share": 0.99},
        rendering={"crossfade_ms": 0.0},
        playout=None,
    )
    assert scene.texture is not None
    frames, _ = mmt.simulate_session(scene, duration_s=14.0)
    quick = np.array_split(frames[:LEARNT_FRAMES], LEARNT_FRAMES // 20)
    slow = np.array_split(frames[LEARNT_FRAMES:], len(frames) - LEARNT_FRAMES)
    together = await Together.listening(scene)
    part = together.leader.parts.vibration
    assert part is not None
    begun = []
    played = []
    add = part.switch.touch_down

    def touch_down(approach_speed_mm_s):
        add(approach_speed_mm_s)
        model = together.leader.parts.completing.rendered
        if model is not None and model.touch_down is not None and part.mode == "synthesized":
            at = sum(map(len, played))
            begun.append((at, model.touch_down.response(approach_speed_mm_s)))

    part.switch.touch_down = touch_down
    write = part.actuator.write

    def noted(vibration):
        played.append(vibration.copy())
        write(vibration)

    part.actuator.write = noted
    await together.follow(MadeSource([*quick, *slow]))
    await together.end()
    output = np.concatenate(played)
    alike = [
        np.corrcoef(output[at : at + SAMPLES], response)[0, 1]
        for at, response in begun
        if at + SAMPLES <= len(output)
    ]
    assert max(alike) > 0.95  # of a touch that does not slide there is nothing else
    session = mmt.read_session(tmp_path / "session.mcap")
    settings = scene.texture.settings()
    history = mmt.build_model(session.frames, settings, scene.texture.update_period_s)
    time_s, data = session.models[-1]
    model = history.model_at(time_s)
    assert model.touch_down is not None
    assert model.to_bytes() == data
