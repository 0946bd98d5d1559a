"""Paper C's data sets, from a simulated hand: trials strung together, segmented, with knocks.

Abdulali et al., section IV: the trials of a texture are one sequence, which is filtered and cut
into segments along its inputs. A tenth of the segments get a knock on the table, one of six. Here
it is added to the recorded acceleration, from somewhere in the segment on, so that it passes the
filters, and may ring on into the next segment.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray, IntArray, RecordArray
from mmt.evaluation.pooling import Pool, pool_sessions
from mmt.scene import Hand, Scene
from mmt.session import RecordedSession
from mmt.testing.simulation.offline import simulate_session
from mmt.texture.interpolation.interpolant import Interpolant, networked
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.segmentation.segmenter import segment, segmentation_settings
from mmt.texture.segmentation.segments import Segment
from mmt.texture.selection import ModelPoints
from mmt.texture.settings import Inputs, ModellingSettings
from mmt.texture.signals.filtering import StreamFilter
from mmt_lab.selection.knocks import placed_knock, simulated_knock
from mmt_lab.selection.running import Row
from mmt_lab.selection.trials import ORDER

TRIAL_S: Final = 20.0
KNOCKS: Final = 6
"""Different knocks in a data set."""

_NORMAL: Final = 2  # the axis that is modelled, z


class NetworkModel(TextureModel):
    """A model by the network of papers B and C, of speed and force too."""

    @cached_property
    def interpolant(self) -> Interpolant:
        """The network through the samples."""
        return networked(self.rendered.vertices)


@dataclass(frozen=True)
class DataSet:
    """The points of a texture.

    Attributes
    ----------
    data
        The first n points, in the order of the recording, n as in the paper.
    knocked
        Which got a knock, shape (n,).
    pool
        All points of the trials, n or a few more.
    trials
        How many trials they come from.
    """

    data: ModelPoints
    knocked: BoolArray
    pool: Pool
    trials: int


def network_settings(inputs: Inputs) -> ModellingSettings:
    """Return the settings of the network of papers B and C, over velocity or speed, and force.

    The papers name no order of the filters; here it is that of all trials of the laboratory.
    """
    return ModellingSettings(method="published", inputs=inputs, order=ORDER)


def settings_of(row: Row) -> ModellingSettings:
    """Return how a texture of paper C is modelled."""
    return network_settings("anisotropic" if row.directed else "isotropic")


def stroke(row: Row, duration_s: float, seed: int) -> RecordArray:
    """Simulate a trial: its frames (n,). A hand takes all headings where they count."""
    scene = Scene(hand=Hand(headings="all" if row.directed else "opposite"))
    return simulate_session(scene, row.surface, duration_s, seed)[0]


def segments_of(frames: RecordArray, settings: ModellingSettings) -> list[Segment]:
    """Filter frames (n,) and cut them into segments."""
    stream = StreamFilter.of(settings)
    return segment(stream.process(frames), segmentation_settings(settings))


def data_set(row: Row, seed: int) -> DataSet:
    """Simulate as many trials as give the paper's number of points, and plant the knocks.

    Parameters
    ----------
    row
        The texture, and how many points and knocks.
    seed
        Seed of all random numbers; trials of other seeds differ.
    """
    settings = settings_of(row)
    generator = np.random.default_rng([seed, row.points])
    trials: list[RecordArray] = []
    found = 0
    while found < row.points:
        trials.append(stroke(row, TRIAL_S, int(generator.integers(2**31))))
        found += len(segments_of(trials[-1], settings))
    frames = _joined(trials)
    segments = segments_of(frames, settings)[: row.points]
    bad = generator.choice(row.points, row.outliers, replace=False)
    _plant(frames, segments, bad, generator)
    pool = pool_sessions([RecordedSession(frames, path=Path(row.surface))], settings)
    knocked = np.zeros(row.points, dtype=np.bool_)
    knocked[bad] = True
    return DataSet(pool.data.subset(np.arange(row.points)), knocked, pool, len(trials))


def _joined(trials: list[RecordArray]) -> RecordArray:
    """Return the trials as one sequence, the clock running on."""
    frames = np.concatenate(trials)
    step_ns = int(trials[0]["time_ns"][1] - trials[0]["time_ns"][0])
    frames["sequence"] = np.arange(len(frames))
    frames["time_ns"] = np.arange(len(frames)) * step_ns
    return frames


def _plant(
    frames: RecordArray, segments: list[Segment], bad: IntArray, generator: np.random.Generator
) -> None:
    """Add a knock to the acceleration at each of the segments, of 0.4 of its variance."""
    knocks = [simulated_knock(generator) for _ in range(KNOCKS)]
    acceleration = frames["acceleration_m_s2"][:, _NORMAL]
    for number in bad.tolist():
        struck, knock = segments[number], knocks[int(generator.integers(KNOCKS))]
        start, placed = placed_knock(struck.vibration_m_s2, knock, generator)
        rung = acceleration[struck.start + start :][: len(placed)]
        rung += placed[: len(rung)]
