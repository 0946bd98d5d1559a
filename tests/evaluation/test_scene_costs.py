"""What a part costs: which scenes are compared, and how noise is kept from being a cost."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from mmt.cli.scene.costs import (
    SceneCosts,
    SceneRun,
    Variant,
    half_width,
    measure_scene,
    packages_of,
    variants_of,
)
from mmt.core.errors import MmtError
from mmt.scene.files import example_scenes, load_scene, scene_from_tables


def test_what_others_need_is_left_out_with_them():
    variants, kept = variants_of(load_scene("demo"))
    assert [variant.left_out for variant in variants] == [
        ("texture", "rendering"),
        ("rendering",),
        ("playout",),
        ("actuator", "rendering", "playout"),
        ("force_feedback",),
        ("recording",),
    ]
    assert kept == ["link", "simulated", "hand"]
    assert variants[0].name == "texture (with rendering)"


@pytest.mark.parametrize("name", example_scenes())
def test_every_variant_is_the_scene_less_what_it_says(name):
    scene = load_scene(name)
    variants, kept = variants_of(scene)
    for variant in variants:
        tables = {k: v for k, v in scene.dump().items() if k not in variant.left_out}
        assert variant.scene.dump() == tables
    touched = {part for variant in variants for part in variant.left_out}
    assert touched | set(kept) == {part for part, runs in scene.parts().items() if runs}
    assert len({frozenset(variant.left_out) for variant in variants}) == len(variants)


def test_the_last_thing_that_the_link_carries_stays():
    scene = scene_from_tables({"link": {}, "replay": {}, "recording": {}})
    assert variants_of(scene) == ([], ["link", "replay", "recording"])


def scene_run(start_s, *modules):
    others = {"core_share": 0.25, "memory_mb": 80.0}
    return SceneRun(
        {"leader": {"start_s": start_s, **others}, "follower": {"start_s": 1.0, **others}},
        {"leader": frozenset({"json", *modules}), "follower": frozenset({"json"})},
        {"up": 64_000.0, "down": 70_000.0},
        None,
    )


def runs_of(seen, start_s):
    def run(scene):
        seen.append(scene)
        return scene_run(start_s(scene), *(["zope"] if scene.playout is not None else []))

    return run


def test_a_part_costs_the_difference_beyond_the_scatter():
    scatter = iter(np.random.default_rng(1).normal(0.0, 0.01, 100).tolist())

    def start_s(scene):
        return 1.0 + (0.3 if scene.playout is not None else 0.0) + next(scatter)

    costs = measure_scene(load_scene("stream-only"), runs_of([], start_s), rounds=4)
    parts = costs.as_dict()["parts"]
    playout, feedback = parts["playout"]["leader"], parts["force_feedback"]["leader"]
    assert playout["start_s"]["seen"]
    assert playout["start_s"]["difference"] == pytest.approx(0.3, abs=0.03)
    assert not feedback["start_s"]["seen"]
    assert not playout["memory_mb"]["seen"], "equal figures are no cost"
    assert playout["packages"] == ["zope"]
    assert feedback["packages"] == []


def test_the_scenes_take_turns():
    seen, steps = [], []
    scene, runs = load_scene("stream-only"), runs_of(seen, lambda _: 1.0)
    costs = measure_scene(scene, runs, rounds=3, on_step=lambda *step: steps.append(step))
    whole = [number for number, one in enumerate(seen) if one == scene]
    assert whole == [0, 4, 8, 12]
    assert all(len(variant.runs) == 3 for variant in costs.variants)
    assert [(number, total) for _, number, total in steps] == [(n, 13) for n in range(13)]
    orders = [[name for name, *_ in steps[first + 1 : first + 4]] for first in whole[:-1]]
    assert len({order[0] for order in orders}) == 3, "each part comes first once"
    assert {tuple(sorted(order)) for order in orders} == {tuple(sorted(orders[0]))}
    figures = costs.as_dict()
    assert figures["services"]["leader"]["start_s"] == {"mean": 1.0, "least": 1.0, "most": 1.0}
    assert figures["parts"]["playout"]["bytes_per_s"] == {"up": 12_000.0, "down": 0.0}
    assert figures["parts"]["playout"]["leader"]["modules"] == 1


def test_a_scene_without_a_part_that_does_not_run_is_said():
    def start_s(scene):
        if scene.force_feedback is None:
            raise MmtError("the device is gone")
        return 1.0

    costs = measure_scene(load_scene("stream-only"), runs_of([], start_s), rounds=2)
    figures = costs.as_dict()
    assert set(figures["parts"]) == {"playout", "actuator (with playout)"}
    assert "force_feedback: not measured, the device is gone" in figures["remarks"]


def test_the_half_width_of_two_groups_is_that_of_the_t_test():
    generator = np.random.default_rng(2)
    first, second = generator.normal(0, 1, 5), generator.normal(3, 1, 4)
    interval = stats.ttest_ind(first, second).confidence_interval(0.95)
    expected = (interval.high - interval.low) / 2
    assert half_width([first.tolist(), second.tolist()], 5, 4) == pytest.approx(expected)


def test_without_a_repetition_nothing_is_told_apart():
    assert half_width([[1.0], [2.0]], 1, 1) == math.inf


@pytest.mark.parametrize("began_s", [None, 4.0])
def test_it_says_when_the_model_was_not_in_use(began_s):
    run = replace(scene_run(1.0), model_from_s=began_s)
    costs = SceneCosts(Variant((), load_scene("demo"), [run]))
    said = " ".join(costs.as_dict()["remarks"])
    assert ("no model was in use within 18 s" in said) == (began_s is None)


def test_packages_are_others_than_pythons_and_our_own():
    modules = ["json.decoder", "mmt.scene", "numpy", "numpy.linalg", "_cffi_backend", "Zope.x"]
    assert packages_of(modules) == ["numpy", "Zope"]


def test_a_whole_scene_that_does_not_run_is_an_error():
    def run(_):
        raise MmtError("no such port")

    with pytest.raises(MmtError, match="no such port"):
        measure_scene(load_scene("demo"), run, rounds=2)


def test_the_whole_alone_is_measured_if_no_parts_are_wanted():
    seen = []
    costs = measure_scene(load_scene("demo"), runs_of(seen, lambda _: 1.0), rounds=2, parts=False)
    assert seen == [load_scene("demo")] * 2
    assert not costs.variants
