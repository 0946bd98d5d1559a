import gc
import pickle

import numpy as np
import pytest

import mmt.texture.online.modeller
from mmt.core.frames import empty_frames
from mmt.scene import Scene
from mmt.testing.simulation.offline import simulate_session
from mmt.texture.completion.distance import distance_sum
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.online.history import build, stream_blocks
from mmt.texture.online.modeller import OnlineModeller
from mmt.texture.segmentation.segmenter import SampleRange
from mmt.texture.settings import ModellingSettings


@pytest.fixture(scope="module")
def frames():
    return simulate_session(Scene(), "plastic", 12.0, 1)[0]


def feed(modeller, frames, block=1000):
    return [
        modeller.update(frames[start : start + block]) for start in range(0, len(frames), block)
    ]


def test_a_model_that_is_never_complete_stays_small_and_spread(frames, monkeypatch):
    settings = ModellingSettings(method="published", start_distance=0.1, stop_distance=0.1)
    whole = OnlineModeller(settings)
    feed(whole, frames)
    monkeypatch.setattr(mmt.texture.online.modeller, "LARGEST_MODEL", 15)
    small = OnlineModeller(whole.settings)
    updates = feed(small, frames)
    assert len(whole.fits) > 20
    assert max(update.samples for update in updates) == 15
    assert sum(update.removed for update in updates) >= len(whole.fits) - 15
    assert closest(small) > closest(whole)
    assert small.completion.progress.value < distance_sum(whole.model.points[-15:])


def closest(modeller):
    points = modeller.model.points
    distances = np.linalg.norm(points[:, None] - points[None], axis=-1)
    return float(distances[~np.eye(len(points), dtype=bool)].min())


def test_of_two_samples_at_one_point_the_older_leaves(monkeypatch):
    monkeypatch.setattr(mmt.texture.online.modeller, "LARGEST_MODEL", 4)
    to_and_fro = empty_frames(12_000)
    to_and_fro["sequence"] = np.arange(12_000)
    way = 150.0 * (-1.0) ** (np.arange(12_000) // 1000)
    to_and_fro["position_mm"][:, 0] = np.cumsum(way) / 1000.0
    to_and_fro["force_n"][:, 2] = 1.5
    to_and_fro["acceleration_m_s2"][:, 2] = np.random.default_rng(0).standard_normal(12_000)
    modeller = OnlineModeller(ModellingSettings(order=6))
    feed(modeller, to_and_fro)
    stops = [stop for _, stop in modeller.fits]
    assert len(stops) == 4
    assert sorted(stops)[1] > 6000


def models_alive():
    gc.collect()
    # by type: to ask a weak proxy of another test for its class may fail
    return sum(type(each) is TextureModel for each in gc.get_objects())


@pytest.mark.parametrize("method", ["field", "published"])
def test_a_history_makes_a_model_when_it_is_asked_for_as_the_live_leader_had_it(frames, method):
    blocks = list(stream_blocks([frames], 1000))
    before = models_alive()
    settings = ModellingSettings(method=method)
    history = build(blocks, settings)
    assert models_alive() == before
    modeller = OnlineModeller(settings)
    for update, block in zip(history.updates, blocks, strict=True):
        live = modeller.update(block).model
        made = update.model
        assert (made is None) == (live is None)
        if made is not None and live is not None:
            assert update.model is made  # as long as it is held
            assert made.to_bytes() == live.to_bytes()
    before = models_alive()
    at_once = build(blocks, settings, deferred=False)
    assert models_alive() >= before + len({update.samples for update in at_once.updates}) - 1
    again = pickle.loads(pickle.dumps(history.updates[-1]))
    assert again.model.to_bytes() == history.updates[-1].model.to_bytes()


@pytest.mark.parametrize("method", ["field", "published"])
def test_what_is_held_out_is_in_no_model_and_all_else_is(frames, method):
    blocks, settings = list(stream_blocks([frames], 1000)), ModellingSettings(method=method)
    history = build(blocks, settings)
    nothing = history.log.without([])
    for number in (3, 11, 0, 7, 7, -1):  # in whatever order
        one, other = history.model(number), nothing.model(number)
        assert (one and one.to_bytes()) == (other and other.to_bytes())
    last = len(blocks) - 1
    whole = history.model(last)
    held_out = [segment.span for segment in history.finished[2:5]]
    left = history.log.without(held_out).model(last)
    kept = {sample.tobytes() for sample in left.samples.lsf}
    assert len(whole.samples) - 3 == len(left.samples)
    assert kept < {sample.tobytes() for sample in whole.samples.lsf}
    everything = history.log.without([SampleRange(0, len(frames))])
    assert everything.model(last) is None
    if method == "field":
        assert whole.field is not None
        assert left.field is not None
        taken = sum(stop - start for start, stop in held_out) / 50
        assert whole.field.sums[:, 0].sum() - left.field.sums[:, 0].sum() == pytest.approx(
            taken, abs=2 * len(held_out)
        )
