"""A simulated follower whose frames have several samples of acceleration, over the real link."""

import asyncio

import numpy as np
from link_samples import LeaderNotes, leader, until

from mmt.core.frames import CHANNELS, frame_dtype
from mmt.follower.service import Follower
from mmt.scene.files import scene_from_tables
from mmt.testing.simulation.follower import SimulatedFollower
from mmt.testing.simulation.textures import get_surface

COUNT = 400


async def test_a_leader_gets_every_sample_that_the_follower_made():
    scene = scene_from_tables(
        {
            "session": {"acceleration_rate_hz": 5000, "seed": 4},
            "link": {"port": 0},
            "simulated": {"surface": "oak"},
            "hand": {},
            "texture": {},
        }
    )
    assert scene.simulated is not None
    notes = LeaderNotes()
    async with leader(notes, channels=CHANNELS, samples_per_frame=5) as server:
        follower = Follower(scene, f"http://127.0.0.1:{server.port}")
        running = asyncio.create_task(follower.run())
        await until(lambda: len(notes.sequences) >= COUNT, 60.0)
        follower.stop()
        summary = await asyncio.wait_for(running, 60.0)
        rejected = server.statistics.rejected
    got = np.concatenate(notes.blocks)
    assert summary.link["frames"] == len(got)
    assert rejected == {}
    assert got.dtype == frame_dtype(CHANNELS, 5)
    surface = get_surface(scene.simulated.surface, 5000.0)
    made = SimulatedFollower(scene.simulated, channels=CHANNELS, seed=4, surface=surface)
    expected = made.step(len(got), 0, None)  # no command came
    for field in ("sequence", "position_mm", "force_n", "acceleration_m_s2"):
        np.testing.assert_array_equal(got[field], expected[field])
