"""What of an imported acceleration is modelled, and what is left out."""

import numpy as np
import pytest
from frame_samples import made_frames

from mmt.session.importing.modelled_share import modelled_sentence


@pytest.mark.parametrize(("x", "share"), [(0.0, 0), (1.0, 50), (3.0, 90)])
def test_the_axes_that_are_left_out_are_told_with_their_power(x, share):
    frames = made_frames(0, 20_000)
    noise = np.random.default_rng(1).standard_normal((len(frames), 2))
    frames["acceleration_m_s2"] = 0.0
    frames["acceleration_m_s2"][:, 0] = 9.81 + x * noise[:, 0]  # gravity is no vibration
    frames["acceleration_m_s2"][:, 2] = noise[:, 1]
    said = modelled_sentence(frames, 1000.0)
    assert said.startswith("modelled: acceleration z; x and y hold ")
    assert int(said.split("hold ")[1].split(" %")[0]) == pytest.approx(share, abs=2)
    assert "kept to" not in said
    assert modelled_sentence(frames, 10_000.0).endswith("; kept to 500 Hz")


def test_nothing_is_said_of_no_vibration():
    frames = made_frames(0, 5000)
    frames["acceleration_m_s2"] = 9.81
    assert modelled_sentence(frames, 1000.0) == ""
    assert modelled_sentence(made_frames(0, 5000, ("position",)), 1000.0) == ""
