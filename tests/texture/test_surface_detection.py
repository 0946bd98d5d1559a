"""The test for another surface: delays, recalls, trials, thresholds."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import freqz
from surface_samples import PEAKED, SMOOTH, make_blocks

from mmt.core.errors import InputError
from mmt.texture.surfaces import SurfaceDetector, SurfacePosterior
from mmt.texture.surfaces.block_likelihood import PreparedBlocks
from mmt.texture.surfaces.blocks import BLOCK, SurfaceBlock
from mmt.texture.surfaces.candidate import Candidate
from mmt.texture.surfaces.detection import EARLY
from mmt.texture.surfaces.prior import SETTINGS
from mmt.texture.surfaces.robustness import RobustnessCheck


def followed(detector: SurfaceDetector, blocks: list[SurfaceBlock]) -> list[tuple[str, int, int]]:
    changes = [detector.update(block) for block in blocks]
    return [(c.kind, c.surface, c.from_sample) for c in changes if c is not None]


def test_the_delay_is_what_the_divergence_of_two_known_processes_says() -> None:
    """Two autoregressive processes of the same shape, 3 dB apart, and how soon that is found.

    The divergence is exact: (r - 1 - log r) / 2 a sample for a ratio r of powers. No test can be
    quicker on the average than the threshold over the divergence (Lorden); learning where the
    new level is and the spectrum's estimate cost some, here up to four times that.
    """
    ratio = 2.0
    per_block = BLOCK * 0.5 * (ratio - 1.0 - np.log(ratio))
    delays = []
    for seed in range(6):
        detector = SurfaceDetector()
        before = make_blocks(SMOOTH, 80, seed)
        assert followed(detector, before) == []
        after = make_blocks(SMOOTH, 30, 100 + seed, amplitude=np.sqrt(ratio), first=80)
        found = next(n for n, block in enumerate(after, 1) if detector.update(block) is not None)
        delays.append(found)
    bound = SurfaceDetector().threshold(touchdown=False) / per_block
    assert bound <= np.mean(delays) <= max(4.0 * bound, 6.0)


def test_other_shapes_of_the_same_power_are_told_apart() -> None:
    power = [np.mean(np.abs(freqz([1.0], np.r_[1.0, ar])[1]) ** 2) for ar in (SMOOTH, PEAKED)]
    alike = float(np.sqrt(power[0] / power[1]))
    detector = SurfaceDetector()
    assert followed(detector, make_blocks(SMOOTH, 60, 5)) == []
    changes = followed(detector, make_blocks(PEAKED, 10, 6, amplitude=alike, first=60))
    assert [(kind, surface) for kind, surface, _ in changes] == [("new", 2)]
    assert 57 * BLOCK <= changes[0][2] <= 61 * BLOCK


def test_a_known_surface_is_recalled() -> None:
    detector = SurfaceDetector()
    found = []
    for turn, ar in enumerate((SMOOTH, PEAKED, SMOOTH, PEAKED)):
        found += followed(detector, make_blocks(ar, 40, turn, first=40 * turn))
    kinds = [(kind, surface) for kind, surface, _ in found]
    assert kinds[0] == ("new", 2)
    assert kinds[-1][1] == 2
    assert {surface for _, surface in kinds} == {1, 2}
    assert len(detector.surfaces) == 2


def test_a_trial_that_began_with_a_block_of_the_former_surface_is_of_the_one_that_follows() -> None:
    detector = SurfaceDetector()
    followed(detector, make_blocks(SMOOTH, 40, 1))
    assert followed(detector, make_blocks(PEAKED, 70, 2, first=40))[0][0] == "new"
    detector._go_to(3)  # as where a change was placed one block too early
    detector._candidate, detector._window, detector._stayed = Candidate(), [], 0
    mixed = make_blocks(PEAKED, 1, 3, first=110) + make_blocks(SMOOTH, 20, 4, first=111)
    assert [(kind, number) for kind, number, _ in followed(detector, mixed)] == [("identified", 1)]
    assert set(detector.surfaces) == {1, 2}
    assert [block.start for block in detector._window] == [BLOCK * n for n in range(111, 131)]


@pytest.mark.parametrize(("amplitude", "kind"), [(1.43, "identified"), (2.0, "recalled")])
def test_a_trial_whose_first_strokes_were_odd_was_of_a_known_surface_if_that_tells_it_all(
    amplitude: float, kind: str
) -> None:
    """Where it does not, the tool was on a new surface first and has come back."""
    detector = SurfaceDetector()
    followed(detector, make_blocks(SMOOTH, 40, 1))
    followed(detector, make_blocks(PEAKED, 70, 2, first=40))
    detector._go_to(3)
    detector._candidate, detector._window, detector._stayed = Candidate(), [], 0
    odd = make_blocks(SMOOTH, 4, 3, first=110, amplitude=amplitude)
    found = followed(detector, odd + make_blocks(SMOOTH, 20, 4, first=114))
    assert [(found_kind, number) for found_kind, number, _ in found] == [(kind, 1)]


def test_an_unexplored_part_of_the_plane_is_no_other_surface() -> None:
    detector = SurfaceDetector()
    assert followed(detector, make_blocks(SMOOTH, 40, 7, high=(-0.4, -0.4))) == []
    assert followed(detector, make_blocks(SMOOTH, 60, 8, low=(0.2, 0.2), first=40)) == []


def test_a_knock_is_no_surface() -> None:
    detector = SurfaceDetector()
    blocks = make_blocks(SMOOTH, 80, 9)
    blocks[50] = replace(blocks[50], log_power=blocks[50].log_power + 6.0)
    assert followed(detector, blocks) == []


def test_what_follows_a_visit_that_was_not_found_is_no_new_surface() -> None:
    """A visit taken for the current surface makes that itself unlikely behind it."""
    current, unknown = SurfacePosterior(), SurfacePosterior()
    current.add(make_blocks(SMOOTH, 60, 9))
    low, high = (0.5, 0.5), (0.6, 0.6)
    visit = make_blocks(SMOOTH, 6, 10, amplitude=3.0, low=low, high=high)
    behind = make_blocks(SMOOTH, 4, 11, low=low, high=high)
    held = RobustnessCheck([*visit, *behind], len(behind), current, unknown)
    apparent = unknown.log_likelihood(PreparedBlocks.of(behind, SETTINGS))[-1]
    heard = PreparedBlocks.of([*visit, *behind], SETTINGS)
    apparent -= current.log_likelihood_after(heard)[-len(behind)]
    assert apparent > 5.0
    assert not held.above(0.0, at_any_heading=True)
    really_new = RobustnessCheck([*behind, *visit], len(visit), current, unknown)
    assert really_new.above(15.0, at_any_heading=True)


def test_where_blocks_have_headings_more_evidence_is_asked_for() -> None:
    plain, headed = SurfaceDetector(), SurfaceDetector(by_heading=True)
    for touchdown in (False, True):
        asked = headed.threshold(touchdown=touchdown)
        assert asked == plain.threshold(touchdown=touchdown) + 2.0


def test_the_surface_that_was_left_for_longest_is_forgotten() -> None:
    detector = SurfaceDetector(most=2)
    for turn, ar in enumerate((SMOOTH, PEAKED, np.array([0.8]))):
        followed(detector, make_blocks(ar, 30, turn, first=30 * turn))
    assert list(detector.surfaces) == [2, 3]


def test_a_lower_rate_takes_more_evidence_and_a_touchdown_less() -> None:
    often, seldom = SurfaceDetector(10.0), SurfaceDetector(0.1)
    assert seldom.threshold(touchdown=False) > often.threshold(touchdown=False)
    assert often.threshold(touchdown=True) < often.threshold(touchdown=False)


def test_a_change_early_in_a_stay_takes_more_evidence_but_behind_a_lift_off() -> None:
    detector = SurfaceDetector()
    early = detector.threshold(touchdown=False, young=True)
    assert early == detector.threshold(touchdown=False) + EARLY
    lifted = detector.threshold(touchdown=True)
    assert detector.threshold(touchdown=True, young=True) == lifted


@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan, np.inf])
def test_a_rate_that_is_none_is_refused(rate: float) -> None:
    with pytest.raises(InputError, match="false_alarms_per_hour"):
        SurfaceDetector(rate)


def test_at_least_two_surfaces_are_kept() -> None:
    with pytest.raises(InputError, match="most"):
        SurfaceDetector(most=1)
