"""Force feedback by each method, both services over the link."""

import pytest
from service_runs import Together, small_scene


def scene_with(directory, method, **tables):
    feedback = {"method": method}
    return small_scene(
        directory,
        force_feedback=feedback,
        playout=None,
        actuator=None,
        recording=None,
        session={"duration_s": 2.5},
        **tables,
    )


@pytest.mark.parametrize("profile", [None, "wan"])
async def test_passive_tells_the_energies_on_both_sides(tmp_path, profile):
    network = {} if profile is None else {"network": {"profile": profile}}
    together = await Together.listening(scene_with(tmp_path, "passive", **network))
    followed = await together.follow()
    led = await together.end()
    assert led.problem is None
    assert led.feedback["method"] == followed.feedback["method"] == "passive"
    assert led.feedback["energy_in_mj"] > 0.0
    assert followed.feedback["energy_out_mj"] > 0.0
    assert 0.0 < followed.feedback["energy_given_mj"] <= led.feedback["energy_in_mj"]
    assert led.feedback["energy_given_mj"] <= followed.feedback["energy_in_mj"] + 1e-3
    injected = led.feedback["energy_injected_mj"]
    assert injected <= 1.0 + led.feedback["energy_overdrawn_mj"] + 1e-3


async def test_the_model_is_estimated_from_what_the_follower_tells(tmp_path):
    together = await Together.listening(scene_with(tmp_path, "model", network={"profile": "wan"}))
    followed = await together.follow()
    led = await together.end()
    assert led.problem is None
    assert followed.feedback["samples"] > 1000
    assert led.feedback["contacts"] >= 1
    # the simulated surface of 5 N/mm; ticks may be missed on a machine that is busy
    assert 2.0 < led.feedback["surface"]["stiffness_n_mm"] < 10.0
    assert led.feedback["felt"]["stiffness_n_mm"] < led.feedback["surface"]["stiffness_n_mm"]


async def test_streamed_says_so_and_sends_nothing_more(tmp_path):
    together = await Together.listening(scene_with(tmp_path, "streamed"))
    followed = await together.follow()
    led = await together.end()
    assert led.feedback["method"] == "streamed"
    assert led.feedback["largest_n"] > 0.0
    assert followed.feedback == {}
