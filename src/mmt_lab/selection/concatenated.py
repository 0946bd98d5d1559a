"""Paper C's data sets, from a simulated hand: trials joined and segmented, with knocks.

Abdulali et al., section IV: the trials of a texture are one sequence, which is filtered and cut
into segments along its inputs. A tenth of the segments get a knock on the table, one of six. Here
the knock is added to the recorded acceleration and begins at a random place in the segment: it
passes the filters, and may ring on into the next segment.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray, RecordArray
from mmt.scene import Hand, Scene, SessionTable
from mmt.session.data import RecordedSession
from mmt.testing.simulation.offline import simulate_session
from mmt.texture.interpolation.interpolant import Interpolant
from mmt.texture.model.rendered import networked
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.segmentation.segmenter import Segment, segment
from mmt.texture.settings import Inputs, ModellingSettings
from mmt.texture.signals.filtering import StreamFilter
from mmt_lab.selection.knocks import SHARE, placed_knock, simulated_knock
from mmt_methods.selection import ModelPoints
from mmt_methods.selection.pooling import Pool, pool_sessions

RATE_HZ: Final = 2000
"""Rate of the vibration: that of paper B's output, and the least for the band of both papers."""

ORDER: Final = 24
"""Order of the filters of models, which the papers do not name: 12 at 1 kHz."""

TRIAL_S: Final = 20.0
KNOCKS: Final = 6
"""Number of different knocks in a data set."""

_NORMAL: Final = 2  # the axis that is modelled, z


class NetworkModel(TextureModel):
    """A model by the network of papers B and C, also if its inputs are speed and force."""

    @cached_property
    def interpolant(self) -> Interpolant:
        """The network through the samples."""
        return networked(self.rendered.vertices)


@dataclass(frozen=True)
class PaperRow:
    """A texture of Tables I and II: the paper's name and numbers, and the known texture used here.

    ``minimal``, ``detected`` and ``kept`` are the sizes of the minimal set, of the outliers that
    were detected and of the set in the end.
    """

    name: str
    surface: str
    points: int
    outliers: int
    directed: bool
    trials: int
    minimal: int
    detected: int
    kept: int
    gain: float


ROWS: Final = (
    PaperRow("Grass", "sandpaper", 236, 23, False, 20, 15, 18, 87, -0.0059),
    PaperRow("Cardboard", "plastic", 253, 25, False, 20, 18, 20, 104, 0.0078),
    PaperRow("Wood", "oak", 432, 43, True, 40, 72, 32, 202, -0.051),
    PaperRow("Washcloth", "corduroy", 461, 46, True, 40, 68, 32, 181, -0.0092),
)


@dataclass(frozen=True, eq=False)
class ConcatenatedTrials:
    """Trials of a texture, joined to one sequence: ``frames`` (k,), and the first n segments.

    ``trials`` is the number of trials.
    """

    frames: RecordArray
    segments: list[Segment]
    trials: int


@dataclass(frozen=True)
class DataSet:
    """The points of a texture: the first n of the recording, n as in the paper.

    ``knocked`` (n,) marks those that got a knock; ``pool`` has all points, n or a few more.
    """

    data: ModelPoints
    knocked: BoolArray
    pool: Pool


def network_settings(inputs: Inputs, order: int = ORDER) -> ModellingSettings:
    """Return the settings of the network of papers B and C, over velocity or speed, and force."""
    samples = RATE_HZ // 1000
    return ModellingSettings(
        method="published", inputs=inputs, order=order, samples_per_frame=samples
    )


def settings_of(row: PaperRow, order: int = ORDER) -> ModellingSettings:
    """Return the settings by which a texture of paper C is modelled."""
    return network_settings("anisotropic" if row.directed else "isotropic", order)


def stroke(surface: str, duration_s: float, seed: int, *, directed: bool) -> RecordArray:
    """Simulate a trial, frames (n,); the hand takes all headings if the texture is directed."""
    session = SessionTable(acceleration_rate_hz=RATE_HZ)
    scene = Scene(session=session, hand=Hand(headings="all" if directed else "opposite"))
    return simulate_session(scene, surface, duration_s, seed)[0]


def segments_of(frames: RecordArray, settings: ModellingSettings) -> list[Segment]:
    """Filter frames (n,) and cut them into segments."""
    stream = StreamFilter(settings)
    return segment(stream.process(frames), settings)


def recording(row: PaperRow, seed: int) -> ConcatenatedTrials:
    """Simulate as many trials as give the paper's number of points."""
    settings = settings_of(row)
    generator = np.random.default_rng([seed, row.points])
    trials: list[RecordArray] = []
    found = 0
    while found < row.points:
        number = int(generator.integers(2**31))
        trials.append(stroke(row.surface, TRIAL_S, number, directed=row.directed))
        found += len(segments_of(trials[-1], settings))
    frames = joined(trials)
    return ConcatenatedTrials(frames, segments_of(frames, settings)[: row.points], len(trials))


def data_set(
    row: PaperRow,
    seed: int,
    recorded: ConcatenatedTrials,
    order: int = ORDER,
    share: float = SHARE,
) -> DataSet:
    """Return a recording's points, with knocks planted."""
    generator = np.random.default_rng([seed, row.points, 1])
    bad = generator.choice(row.points, row.outliers, replace=False)
    frames = recorded.frames.copy()
    kinds = [simulated_knock(generator, RATE_HZ) for _ in range(KNOCKS)]
    every = frames["acceleration_m_s2"]
    acceleration = every[..., _NORMAL].ravel()
    for number in bad.tolist():
        struck, knock = recorded.segments[number], kinds[int(generator.integers(len(kinds)))]
        start, placed = placed_knock(struck.vibration_m_s2, knock, generator, share)
        rung = acceleration[struck.start * every.shape[1] + start :][: len(placed)]
        rung += placed[: len(rung)]
    every[..., _NORMAL] = acceleration.reshape(every.shape[:2])
    session = RecordedSession(frames, path=Path(row.surface))
    pool = pool_sessions([session], settings_of(row, order))
    knocked = np.zeros(row.points, dtype=np.bool_)
    knocked[bad] = True
    return DataSet(pool.data.subset(np.arange(row.points)), knocked, pool)


def joined(trials: list[RecordArray]) -> RecordArray:
    """Return the trials as one sequence, with a continuous clock."""
    frames = np.concatenate(trials)
    step_ns = int(trials[0]["time_ns"][1] - trials[0]["time_ns"][0])
    frames["sequence"] = np.arange(len(frames))
    frames["time_ns"] = np.arange(len(frames)) * step_ns
    return frames
