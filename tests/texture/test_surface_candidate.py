"""The trial of a new surface against the mixture computed by hand."""

import numpy as np
import pytest
from surface_samples import PEAKED, SMOOTH, make_blocks

from mmt.core.arrays import FloatArray
from mmt.texture.surfaces import SurfaceBlock, SurfacePosterior
from mmt.texture.surfaces.block_likelihood import PreparedBlocks
from mmt.texture.surfaces.candidate import Candidate
from mmt.texture.surfaces.prior import SETTINGS


def jointly(knowledge: SurfacePosterior, blocks: list[SurfaceBlock]) -> FloatArray:
    """Return how likely no block is, the first, the first two, and so on."""
    return np.r_[0.0, knowledge.log_likelihood(PreparedBlocks.of(blocks, SETTINGS))]


def learned(ar: FloatArray, seed: int, amplitude: float = 1.0) -> SurfacePosterior:
    knowledge = SurfacePosterior()
    knowledge.add(make_blocks(ar, 60, seed, amplitude=amplitude))
    return knowledge


@pytest.fixture(name="known")
def two_surfaces() -> dict[int, SurfacePosterior]:
    return {3: learned(SMOOTH, 1), 5: learned(PEAKED, 2, amplitude=0.7)}


@pytest.mark.parametrize(("ar", "seed"), [(SMOOTH, 3), (PEAKED, 4), (np.array([0.8]), 5)])
def test_what_comes_next_is_expected_as_the_mixture_expects_it(known, ar, seed) -> None:
    """The ratio of the sums of what each hypothesis makes of all blocks, and of those before."""
    blocks = make_blocks(ar, 12, seed)
    unknown = SurfacePosterior()
    trial = Candidate(blocks)
    trial.compare(unknown, known)
    weights = np.log([0.5, 0.25, 0.25])
    each = np.array([jointly(surface, blocks) for surface in (unknown, *known.values())])
    total = np.logaddexp.reduce(weights[:, None] + each)
    newest = np.arange(1, 8)
    alone = each[0][-1] - each[0][-1 - newest]
    assert trial.after(alone) == pytest.approx(total[-1] - total[-1 - newest], abs=1e-9)


def test_a_trial_beside_no_known_surface_is_what_it_has_told_itself() -> None:
    trial = Candidate(make_blocks(SMOOTH, 5, 1))
    trial.compare(SurfacePosterior(), {})
    alone = np.array([-3.0, -7.0, -9.0])
    assert np.array_equal(trial.after(alone), alone)
    assert not trial.is_compared


def test_the_known_surface_that_it_is_leads_by_what_the_next_one_lacks(known) -> None:
    blocks = make_blocks(PEAKED, 15, 7, amplitude=0.7)
    unknown = SurfacePosterior()
    trial = Candidate(blocks)
    trial.compare(unknown, known)
    number, lead = trial.leading()
    every = {n: jointly(surface, blocks)[-1] for n, surface in {0: unknown, **known}.items()}
    assert number == 5
    assert lead == pytest.approx(every[5] - max(every[0], every[3]), abs=1e-9)
    assert lead > 7.0


def test_no_known_surface_leads_where_it_is_another_one(known) -> None:
    trial = Candidate(make_blocks(np.array([0.8]), 15, 7))
    trial.compare(SurfacePosterior(), known)
    assert trial.leading()[1] < 0.0


def test_a_surface_far_from_all_is_judged_by_what_it_has_told_itself(known) -> None:
    """Where every known surface is out of the question nothing is lost to rounding."""
    blocks = make_blocks(SMOOTH, 10, 8, amplitude=1e4)
    unknown = SurfacePosterior()
    trial = Candidate(blocks)
    trial.compare(unknown, known)
    alone = np.array([-1.0, -2.5])
    assert trial.after(alone) == pytest.approx(alone, abs=1e-9)
