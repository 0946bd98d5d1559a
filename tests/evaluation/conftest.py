"""A session on a known texture, and its evaluations with and without that knowledge."""

from dataclasses import replace
from pathlib import Path

import pytest

from mmt.evaluation.evaluate import evaluate_session
from mmt.scene import Scene
from mmt.session.data import RecordedSession
from mmt.testing.simulation.offline import simulate_session


@pytest.fixture(scope="session")
def simulated():
    frames, annotations = simulate_session(Scene(), "plastic", 8.0, seed=4)
    return RecordedSession(frames, annotations=annotations, path=Path("plastic.mcap"))


@pytest.fixture(scope="session")
def known(simulated):
    return evaluate_session(simulated)


@pytest.fixture(scope="session")
def unknown(simulated):
    return evaluate_session(replace(simulated, annotations=b""))
