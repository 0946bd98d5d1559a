"""Blocks, and what is known of a surface."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.stats import multivariate_normal
from surface_samples import PEAKED, SMOOTH, make_blocks

from mmt.core.arrays import RecordArray
from mmt.texture.signals.aligned import AlignedBlock
from mmt.texture.surfaces import BlockCutter, SurfaceDetector, SurfacePosterior
from mmt.texture.surfaces.block_likelihood import PreparedBlocks, log_densities
from mmt.texture.surfaces.blocks import BANDS, BLOCK, SurfaceBlock, band_log_power
from mmt.texture.surfaces.covariance import Covariances, SettingInputs
from mmt.texture.surfaces.posterior import SHARED
from mmt.texture.surfaces.prior import (
    GRAINED,
    NOISE,
    PRIORS,
    SETTINGS,
    Setting,
    cosine_transform,
    settings_of,
)


def stream(count: int, *, speed: float = 100.0, force: float = 1.0, first: int = 0) -> AlignedBlock:
    """Return aligned samples of a steady stroke."""
    index = np.arange(first, first + count)
    vibration = np.random.default_rng(first).standard_normal((count, 1))
    return AlignedBlock(
        index=index,
        time_ns=index * 1_000_000,
        position_mm=np.zeros((count, 3)),
        velocity_mm_s=np.tile([0.0, speed], (count, 1)),
        speed_mm_s=np.full(count, speed),
        normal_force_n=np.full(count, force),
        vibration_m_s2=vibration,
        valid=np.ones(count, dtype=np.bool_),
    )


def stacked(blocks: list[SurfaceBlock]) -> tuple[np.ndarray, np.ndarray]:
    return np.array([b.inputs for b in blocks]), np.array([b.log_power for b in blocks])


def likelihood(surface: SurfacePosterior, blocks: list[SurfaceBlock]) -> np.ndarray:
    return surface.log_likelihood(PreparedBlocks.of(blocks, surface.settings))


# --- blocks


def test_a_steady_stroke_is_cut_into_blocks_of_100_behind_its_first_20_samples() -> None:
    blocks = BlockCutter().cut(stream(1030))
    assert [(b.start, b.stop) for b in blocks] == [(20 + 100 * k, 120 + 100 * k) for k in range(10)]
    assert [b.touchdown for b in blocks] == [True] + [False] * 9


def test_the_cut_into_updates_does_not_matter() -> None:
    whole = BlockCutter().cut(stream(1000))
    cutter = BlockCutter()
    samples = stream(1000)
    parts = [cutter.cut(samples[start : start + 37]) for start in range(0, 1000, 37)]
    found = [block for part in parts for block in part]
    assert [b.start for b in found] == [b.start for b in whole]
    np.testing.assert_array_equal(stacked(found)[1], stacked(whole)[1])


@pytest.mark.parametrize(
    ("speed", "force"), [(5.0, 1.0), (100.0, 0.06), (100.0, 0.0)], ids=["slow", "light", "lifted"]
)
def test_what_is_slow_or_light_is_in_no_block(speed: float, force: float) -> None:
    assert BlockCutter().cut(stream(1000, speed=speed, force=force)) == []


def test_a_gap_and_a_change_of_speed_begin_a_block_anew() -> None:
    cutter = BlockCutter()
    assert cutter.cut(stream(90)) == []
    fast = cutter.cut(stream(100, speed=300.0, first=90))
    assert [(b.start, b.stop) for b in fast] == [(90, 190)]
    assert cutter.cut(stream(90, first=200)) == []


def test_the_next_contact_is_a_touchdown() -> None:
    cutter = BlockCutter()
    cutter.cut(stream(200))
    cutter.cut(stream(100, force=0.0, first=200))
    again = cutter.cut(stream(200, first=300))
    assert again[0].touchdown
    assert again[0].contact_start == 300


@pytest.mark.parametrize("band", range(BANDS))
def test_a_tone_is_heard_in_its_band(band: int) -> None:
    tone = np.sin(2 * np.pi * (40.0 + 50.0 * band) / 1000.0 * np.arange(BLOCK))[:, None]
    assert int(np.argmax(band_log_power(tone))) == band
    np.testing.assert_allclose(band_log_power(2 * tone) - band_log_power(tone), np.log(4.0))


def test_the_scatter_of_white_noise_is_what_is_assumed() -> None:
    random = np.random.default_rng(1)
    powers = np.array([band_log_power(random.standard_normal((BLOCK, 1))) for _ in range(2000)])
    np.testing.assert_allclose(powers.var(axis=0).mean(), NOISE, rtol=0.06)
    np.testing.assert_allclose(np.exp(powers).mean(), 0.1, rtol=0.03)  # 50 of 500 Hz


def test_silence_has_a_finite_power() -> None:
    assert np.isfinite(band_log_power(np.zeros((BLOCK, 1)))).all()


# --- what is known of a surface


def test_an_unknown_surface_has_the_density_of_the_prior() -> None:
    """By an independent oracle: covariances written out, and scipy's normal density."""
    blocks = make_blocks(SMOOTH, 4, 1)
    inputs, log_power = stacked(blocks)
    values = log_power @ cosine_transform().T
    speed, force = inputs.T
    densities = []
    for setting in (Setting(*record) for record in SETTINGS.tolist()):
        far = np.exp(-0.5 * np.subtract.outer(force, force) ** 2 / setting.length**2)
        smooth = np.exp(-0.5 * np.subtract.outer(speed, speed) ** 2 / setting.length**2)
        moved = np.subtract.outer(np.exp(speed), np.exp(speed)) / setting.period
        rough = setting.residual**2 * smooth + setting.lines**2 * np.exp(-0.5 * moved**2)
        total = 0.0
        for prior in PRIORS.values():
            spread = prior.constant**2 + prior.per_speed**2 * np.outer(speed, speed)
            spread += prior.per_force**2 * np.outer(force, force)
            spread += prior.roughness**2 * rough * far
            spread *= prior.scale
            spread += setting.noise * NOISE * np.eye(4)
            mean = prior.mean[0] + prior.mean[1] * speed + prior.mean[2] * force
            for k in range(prior.first, prior.last):
                normal = multivariate_normal(np.sqrt(prior.scale) * mean, spread)
                total += normal.logpdf(values[:, k])
        densities.append(total)
    expected = np.log(np.mean(np.exp(np.array(densities) - max(densities)))) + max(densities)
    found = likelihood(SurfacePosterior(), blocks)
    np.testing.assert_allclose(found[-1], expected, rtol=1e-9)


def test_densities_by_the_factor_are_those_of_the_normal_distribution() -> None:
    random = np.random.default_rng(4)
    roots = random.standard_normal((3, 6, 6))
    spreads = roots @ roots.transpose(0, 2, 1) + NOISE * np.eye(6)
    for rests in (random.standard_normal((3, 6, 2)), 1e6 * random.standard_normal((1, 6, 2))):
        found = log_densities(rests, spreads)
        for k, n in ((0, 1), (1, 4), (2, 6)):
            normal = multivariate_normal(np.zeros(n), spreads[k, :n, :n])
            expected = normal.logpdf(rests[min(k, len(rests) - 1), :n].T).sum()
            np.testing.assert_allclose(found[k, n - 1], expected, rtol=1e-8)


def test_what_was_learned_is_the_chain_rule_of_the_joint_density() -> None:
    """p(new | learned) = p(learned, new) / p(learned), with each block in a cell of its own."""
    blocks = make_blocks(PEAKED, 9, 2)
    learned, new = blocks[:6], blocks[6:]
    surface, unknown = SurfacePosterior(), SurfacePosterior()
    surface.add(learned)
    assert len(surface) == 6
    joint = likelihood(unknown, learned + new)
    # Settings that the cells make less likely than e^-12 are left out.
    np.testing.assert_allclose(likelihood(surface, new), joint[6:] - joint[5], rtol=0.0, atol=1e-4)


@pytest.mark.parametrize("settings", [SETTINGS[:1], SETTINGS], ids=len)
def test_what_follows_is_predicted_from_what_came_before(settings: RecordArray) -> None:
    """Exactly so with one degree of roughness; with several a share of the weight is spread."""
    surface = SurfacePosterior(settings)
    surface.add(make_blocks(SMOOTH, 10, 2))
    heard = PreparedBlocks.of(make_blocks(PEAKED, 12, 3), settings)
    so_far = surface.log_likelihood(heard)
    exact = so_far[-1] - np.append(0.0, so_far[:-1])
    after = surface.log_likelihood_after(heard)
    if len(settings) == 1:
        np.testing.assert_allclose(after, exact, atol=1e-9)
    assert (after >= exact + np.log1p(-SHARED) - 1e-9).all()


def test_what_was_smooth_so_far_may_be_rough_elsewhere() -> None:
    """Where a rough degree predicts better it counts, however unlikely it was before."""
    two = settings_of(Setting(0.12, 0.7, 1.1), Setting(0.6, 0.7, 1.8))
    surface = SurfacePosterior(two)
    blocks = make_blocks(SMOOTH, 16, 2)
    blocks[8:] = [
        replace(b, log_power=b.log_power + 1.2 * (-1) ** n) for n, b in enumerate(blocks[8:])
    ]
    rough = likelihood(SurfacePosterior(two[1:]), blocks)
    spread = surface.log_likelihood_after(PreparedBlocks.of(blocks, two))[8]
    assert spread >= rough[-1] - rough[7] + np.log(SHARED / 2) - 1e-9


def test_a_surface_is_known_where_it_was_touched_and_less_far_from_there() -> None:
    surface = SurfacePosterior()
    surface.add(make_blocks(SMOOTH, 60, 3, low=(-0.3, -0.3), high=(0.3, 0.3)))
    near, far = np.zeros((1, 2)), np.array([[1.0, -2.0]])
    for kind, spread in surface.spread(near).items():
        assert spread[0] < 0.3
        assert spread[0] < surface.spread(far)[kind][0]
        assert surface.spread(far)[kind][0] < SurfacePosterior().spread(far)[kind][0]


HEADED = np.concatenate([SETTINGS, GRAINED])


def headed(
    count: int,
    seed: int,
    *,
    gain: float,
    heading: float | None = None,
    ar: np.ndarray = SMOOTH,
) -> list[SurfaceBlock]:
    """Return blocks along random headings, or one; their level swings by `gain` with it."""
    random = np.random.default_rng(seed)
    blocks = []
    for block in make_blocks(ar, count, seed):
        angle = float(random.uniform(-np.pi, np.pi)) if heading is None else heading
        inputs = np.r_[block.inputs, np.cos(angle), np.sin(angle)]
        louder = block.log_power + gain * np.cos(2.0 * angle)
        blocks.append(replace(block, inputs=inputs, log_power=louder))
    return blocks


def test_only_a_texture_that_is_the_same_in_all_directions_is_known_in_all_of_them() -> None:
    along_and_across = np.array([[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    known = {}
    for gain in (0.0, 1.0):
        knowledge = SurfacePosterior(HEADED)
        knowledge.add([b for b in headed(200, 3, gain=gain) if abs(b.inputs[3]) < 0.7])
        known[gain] = knowledge.spread(along_and_across)["level"]
    assert known[0.0][1] < 1.3 * known[0.0][0]
    assert known[1.0][1] > 1.8 * known[1.0][0]


def test_a_grain_is_known_there_and_back_but_not_across() -> None:
    knowledge = SurfacePosterior(GRAINED)
    knowledge.add(headed(40, 3, gain=0.0, heading=0.0))
    there, back, across = knowledge.spread(
        np.array([[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    )["level"]
    assert there < back < 0.6 * across


def ridged(count: int, seed: int, *, across: float) -> list[SurfaceBlock]:
    """Return blocks of ridges: a line whose band follows the speed across them."""
    random = np.random.default_rng(seed)
    bands = np.arange(BANDS)
    found = []
    for block in make_blocks(SMOOTH, count, seed):
        angle = float(random.uniform(-np.pi, np.pi))
        turned = angle - across
        heard = np.exp(block.inputs[0]) * np.hypot(np.cos(turned), 0.15 * np.sin(turned))
        line = 2.5 * np.exp(-0.5 * (bands - 3.0 * heard) ** 2) + np.log(heard)
        inputs = np.r_[block.inputs, np.cos(angle), np.sin(angle)]
        found.append(replace(block, inputs=inputs, log_power=block.log_power + line))
    return found


@pytest.mark.parametrize("across", [0.0, 1.1, 2.6])
def test_the_direction_of_ridges_is_learned(across: float) -> None:
    knowledge = SurfacePosterior(HEADED)
    knowledge.add(ridged(80, 3, across=across))
    likeliest = Setting(*HEADED[knowledge.likeliest].tolist())
    assert likeliest.along < 1.0
    assert not likeliest.crossed
    assert np.cos(2.0 * (likeliest.across - across)) > np.cos(2.0 * np.radians(11.0))


def test_ridges_are_heard_by_the_speed_across_them() -> None:
    """A fast stroke at a slant is one that goes slowly straight across."""
    setting = settings_of(Setting(0.2, 0.7, 1.2, 0.6, 0.5, across=0.4, along=0.15))
    slant = 0.4 + np.pi / 3.0
    heard = np.log(np.hypot(np.cos(slant - 0.4), 0.15 * np.sin(slant - 0.4)))
    inputs = np.array([[0.0, 0.0, np.cos(slant), np.sin(slant)]])
    straight = np.array([[heard, 0.0, np.cos(0.4), np.sin(0.4)]])
    places = SettingInputs(inputs, setting), SettingInputs(straight, setting)
    np.testing.assert_allclose(places[0].across, places[1].across, atol=1e-12)
    np.testing.assert_allclose(places[0].mean(PRIORS["level"]), places[1].mean(PRIORS["level"]))


@settings(max_examples=40)
@given(
    hnp.arrays(np.float64, (6, 2), elements=st.floats(-4.0, 2.0)),
    hnp.arrays(np.float64, (6,), elements=st.floats(-np.pi, np.pi)),
)
def test_every_covariance_is_symmetric_and_has_no_negative_eigenvalue(
    inputs: np.ndarray, angle: np.ndarray
) -> None:
    places = SettingInputs(np.column_stack([inputs, np.cos(angle), np.sin(angle)]), HEADED)
    within = Covariances(places, places)
    for prior in PRIORS.values():
        matrices = within.of(prior)
        np.testing.assert_allclose(matrices, matrices.transpose(0, 2, 1), atol=1e-9)
        assert np.linalg.eigvalsh(matrices).min() > -1e-9 * matrices.max()


def test_a_texture_that_depends_on_the_heading_is_one_surface() -> None:
    detector = SurfaceDetector(by_heading=True)
    found = [detector.update(block) for block in headed(200, 5, gain=1.0)]
    assert [change for change in found if change is not None] == []
    other = [detector.update(block) for block in headed(40, 6, gain=-1.0)]
    assert [change.kind for change in other if change is not None] == ["new"]


@pytest.mark.parametrize(
    ("heading", "kinds"), [(1.57, set()), (0.2, {"new"})], ids=["across", "along"]
)
def test_what_is_heard_at_another_heading_alone_is_no_new_surface(
    heading: float, kinds: set[str]
) -> None:
    detector = SurfaceDetector(by_heading=True)
    blocks = headed(40, 5, gain=0.0, heading=0.0)
    blocks += headed(10, 6, gain=0.0, heading=heading, ar=PEAKED)
    found = [detector.update(block) for block in blocks]
    assert {change.kind for change in found if change is not None} == kinds


@pytest.mark.parametrize(("lifted", "kinds"), [(False, []), (True, ["new", "identified"])])
def test_a_heading_never_touched_recalls_a_surface_only_behind_a_lift_off(
    lifted: bool, kinds: list[str]
) -> None:
    detector = SurfaceDetector(by_heading=True)
    detector.surfaces = {7: SurfacePosterior(HEADED), **detector.surfaces}
    detector.surfaces[7].add(headed(80, 4, gain=0.0, ar=PEAKED))
    for block in headed(40, 5, gain=0.0, heading=0.0):
        assert detector.update(block) is None
    across = headed(8, 6, gain=0.0, heading=1.57, ar=PEAKED)
    across[0] = replace(across[0], touchdown=lifted)
    across[1:] = [replace(block, touchdown=False) for block in across[1:]]
    found = [change for block in across if (change := detector.update(block)) is not None]
    assert [change.kind for change in found] == kinds
    assert detector.current == (7 if lifted else 1)


def test_where_the_heading_does_not_count_another_heading_is_another_surface() -> None:
    detector = SurfaceDetector()
    blocks = [*headed(40, 5, gain=1.0, heading=0.0), *headed(40, 6, gain=1.0, heading=1.57)]
    found = [detector.update(replace(block, inputs=block.inputs[:2])) for block in blocks]
    assert "new" in [change.kind for change in found if change is not None]


@settings(max_examples=25)
@given(
    hnp.arrays(np.float64, (5, 2), elements=st.floats(-4.0, 2.0)),
    hnp.arrays(np.float64, (5, BANDS), elements=st.floats(-27.0, 27.0)),
    hnp.arrays(np.float64, (5,), elements=st.just(np.nan) | st.floats(-np.pi, np.pi)),
)
def test_densities_are_finite_whatever_was_learned(
    inputs: np.ndarray, log_power: np.ndarray, angle: np.ndarray
) -> None:
    """Also where a stroke goes to and fro within a block, and has no heading."""
    direction = np.nan_to_num(np.column_stack([np.cos(angle), np.sin(angle)]))
    template = make_blocks(SMOOTH, 1, 0)[0]
    for which, places in ((SETTINGS, inputs), (HEADED, np.column_stack([inputs, direction]))):
        surface = SurfacePosterior(which)
        surface.add(
            [
                replace(template, inputs=i, log_power=p)
                for i, p in zip(places, log_power, strict=True)
            ]
        )
        assert np.isfinite(surface.log_likelihood(PreparedBlocks(places, log_power, which))).all()


def test_the_evidence_for_another_surface_seldom_grows_where_there_is_none() -> None:
    """Ville's inequality: a Bayes factor exceeds e^h with a probability of e^-h at most."""
    exceeded = 0
    for seed in range(100):
        blocks = make_blocks(SMOOTH, 26, seed)
        surface = SurfacePosterior()
        surface.add(blocks[:20])
        new = blocks[20:]
        factor = likelihood(SurfacePosterior(), new) - likelihood(surface, new)
        exceeded += bool(factor.max() > 2.0)
    assert exceeded <= 100 * np.exp(-2.0)
