"""The speed with which a hand meets the surface, and whether its touch-down is heard."""

import numpy as np
import pytest

from mmt.devices.protocols import InterfaceState
from mmt.leader.output.model_crossfade import ModelCrossfade
from mmt.leader.output.synthesis import Landing
from mmt.leader.output.vibration import VibrationSwitch


def hand(velocity_mm_s, contact):
    return InterfaceState((0.0, 0.0, 0.0), (9.0, 9.0, velocity_mm_s), float(contact), contact)


def test_the_hands_speed_is_that_before_its_contact():
    for elapsed in (1, 3, 100):
        landing = Landing(2, 1000.0)
        for _ in range(0, 30, elapsed):
            assert landing.step(hand(-70.0, contact=False), elapsed) == 0.0
        assert landing.step(hand(-1.0, contact=True), 1) == pytest.approx(70.0)
        assert landing.step(hand(-1.0, contact=True), 1) == 0.0


@pytest.mark.parametrize("before", ["short", "lost", "upwards", "none"])
def test_no_approach_is_no_touch_down(before):
    landing = Landing(2, 1000.0)
    for _ in range({"short": 10, "none": 0}.get(before, 30)):
        landing.step(hand(5.0 if before == "upwards" else -70.0, contact=False), 1)
    if before == "lost":
        landing.step(None, 1)
    assert landing.step(hand(-70.0, contact=True), 1) == 0.0


class Landed:
    """Renders one for each touch-down, once."""

    directed = False

    def __init__(self):
        self.model = None
        self.speeds = []

    def touch_down(self, approach_speed_mm_s):
        self.speeds.append(approach_speed_mm_s)

    def reset(self):
        pass

    def render(self, *inputs):
        return np.zeros(len(inputs[0]))


@pytest.mark.parametrize("crossfade", [False, True])
def test_it_is_heard_with_the_model_alone(crossfade):
    one, other = Landed(), Landed()
    renderer = ModelCrossfade(one, other, crossfade_samples=10) if crossfade else one
    switch = VibrationSwitch(lambda _: (0.0,), renderer, crossfade_samples=5)
    for wanted, speed in ((False, 80.0), (True, 60.0), (False, 40.0)):
        switch.use_model(wanted)
        for _ in range(3):
            switch.render(0, np.zeros(1), np.zeros(1))
        switch.touch_down(speed)
        for _ in range(5):
            switch.render(0, np.zeros(1), np.zeros(1))
    switch.touch_down(20.0)
    assert one.speeds == [60.0, 40.0]  # the last in mid-fade
    assert not other.speeds
    if crossfade:
        renderer.cross_to(None)
        switch.use_model(True)
        switch.render(0, np.zeros(1), np.zeros(1))
        switch.touch_down(10.0)
        assert (one.speeds, other.speeds) == ([60.0, 40.0], [10.0])


def test_a_renderer_that_knows_none_is_left_alone():
    class Plain:
        directed = False

        def render(self, *inputs):
            return np.zeros(len(inputs[0]))

    switch = VibrationSwitch(None, Plain(), crossfade_samples=0)
    switch.use_model(True)
    switch.render(0, np.zeros(1), np.zeros(1))
    switch.touch_down(10.0)
