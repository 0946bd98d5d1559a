"""The locally rendered contact: smooth, bounded, and passive through its port."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmt.contact.estimation import ContactModel
from mmt.contact.passivity import REACH_M_S2, ForcePort, PassivitySettings
from mmt.contact.rendering import LocalContact, RenderingSettings
from mmt.core.errors import InputError

models = st.builds(
    ContactModel,
    surface_m=st.floats(-0.005, 0.005),
    stiffness_n_m=st.floats(1e2, 1e5),
    exponent=st.sampled_from([1.0, 1.5, 2.0]),
    damping_n_s_m=st.floats(0.0, 100.0),
    dissipation_s_m=st.floats(0.0, 5.0),
)


def test_it_becomes_the_model_it_aims_at():
    contact = LocalContact()
    contact.set_target(ContactModel(0.0, 500.0, damping_n_s_m=2.0))
    contact.step(0.001)
    target = ContactModel(0.001, 3000.0, 1.2, dissipation_s_m=0.5)
    contact.set_target(target)
    for _ in range(500):
        contact.step(0.003)
    assert contact.rendered.stiffness_n_m == pytest.approx(3000.0, rel=1e-6)
    assert contact.rendered.exponent == pytest.approx(1.2)
    assert contact.step(0.003) == pytest.approx(target.force_n(0.003, 0.0), rel=1e-6)


def test_a_change_of_the_model_is_no_step_of_the_force():
    contact = LocalContact()
    contact.set_target(ContactModel(0.0, 200.0))
    force = 0.0
    for _ in range(100):
        force = contact.step(0.002)
    contact.set_target(ContactModel(-0.001, 2000.0))
    largest = 0.0
    for _ in range(300):
        now = contact.step(0.002)
        largest = max(largest, abs(now - force))
        force = now
    assert force == pytest.approx(6.0, rel=1e-3)
    assert largest < 0.06 * 6.0


def test_a_stiff_model_is_rendered_as_stiff_as_allowed():
    contact = LocalContact(RenderingSettings(stiffness_n_m=2000.0, damping_n_s_m=1.0))
    for model in (ContactModel(0.0, 1e5, damping_n_s_m=50.0), ContactModel(0.0, 1e9, 2.0)):
        contact.set_target(model)
        for _ in range(1000):
            contact.step(0.001)
        assert contact.step(0.001) == pytest.approx(2.0, rel=1e-3)


def test_missed_ticks_make_no_difference_to_where_it_gets():
    one, five = LocalContact(), LocalContact()
    for contact in (one, five):
        contact.set_target(ContactModel(0.0, 100.0))
        contact.step(0.001)
        contact.set_target(ContactModel(0.0, 1000.0))
    for _ in range(20):
        one.step(0.001)
    for _ in range(4):
        five.step(0.001, ticks=5)
    assert one.rendered.stiffness_n_m == pytest.approx(five.rendered.stiffness_n_m)


def test_without_a_model_and_without_a_place_there_is_no_force():
    contact = LocalContact()
    contact.set_target(None)
    assert contact.step(0.01) == 0.0
    contact.set_target(ContactModel(0.0, 100.0))
    assert contact.step(math.nan) == 0.0
    assert contact.step(0.01) > 0.0


@given(
    st.lists(st.tuples(st.none() | models, st.floats(-1.0, 1.0)), min_size=1, max_size=150),
    st.floats(1e2, 1e5),
)
def test_no_sequence_of_updates_gives_energy_to_the_hand(ticks, stiffest):
    """Random models at random ticks; exact work on a hand within its reach of acceleration."""
    limits = PassivitySettings()
    contact, port = LocalContact(RenderingSettings(stiffness_n_m=stiffest)), ForcePort(limits)
    net = least = depth = travel = force = 0.0
    port.step(0.0, 0.0)
    for model, push in ticks:
        contact.set_target(model)
        travel += push * REACH_M_S2 * limits.tick_s**2
        depth += travel
        net -= force * travel
        least = min(least, net)
        force = port.step(-contact.step(depth), depth)
    assert least >= -limits.reserve_j * (1 + 1e-6)


@pytest.mark.parametrize(
    "wrong", [{"stiffness_n_m": 0.0}, {"damping_n_s_m": math.nan}, {"smoothing_s": -1.0}]
)
def test_settings_out_of_range_are_named(wrong):
    with pytest.raises(InputError, match=next(iter(wrong))):
        RenderingSettings(**wrong)
