"""The emulated HD library keeps the rules of the real one, so that a driver learns them."""

import ctypes

import pytest
from emulated_arm import emulated_arm  # noqa: F401 - a fixture

from mmt.devices.openhaptics.library import (
    CURRENT_FORCE,
    FORCE_OUTPUT,
    Vector3,
    name_of,
    open_stack,
)


@pytest.fixture
def stack(emulated):
    """The library with its scheduler at rest, so that frames are the test's own."""
    opened = open_stack(emulated.address)
    opened.pop_errors()
    opened.device = opened.hd.hdInitDevice(None)
    yield opened
    opened.hd.hdDisableDevice(opened.device)
    opened.pop_errors()


def names(stack):
    return [name_of(error.code) for error in stack.pop_errors()]


def test_frames_are_neither_nested_nor_ended_twice_and_errors_pop_newest_first(stack):
    stack.hd.hdBeginFrame(stack.device)
    stack.hd.hdBeginFrame(stack.device)
    stack.hd.hdEndFrame(stack.device)
    stack.hd.hdEndFrame(stack.device)
    stack.hd.hdEndFrame(77)
    stack.hd.hdGetDoublev(0x1234, Vector3())
    assert names(stack) == ["INVALID_ENUM", "BAD_HANDLE", "ILLEGAL_END", "ILLEGAL_BEGIN"]
    assert names(stack) == []


def test_a_force_belongs_into_a_frame_and_is_gone_in_the_next_one(stack, emulated):
    force = Vector3(1.0, 0.0, 0.0)
    stack.hd.hdEnable(FORCE_OUTPUT)
    stack.hd.hdSetDoublev(CURRENT_FORCE, force)
    assert names(stack) == ["INVALID_OPERATION"]
    for expected in (1.0, 0.0):
        stack.hd.hdBeginFrame(stack.device)
        if expected:
            stack.hd.hdSetDoublev(CURRENT_FORCE, force)
        stack.hd.hdEndFrame(stack.device)
        assert emulated.tip_state(device=stack.device).motor_n[0] == expected
    assert names(stack) == []


def test_a_force_beyond_the_maximum_is_an_error_unless_it_is_clamped(stack, emulated):
    stack.hd.hdEnable(FORCE_OUTPUT)
    for clamp, expected, errors in ((False, 0.0, ["EXCEEDED_MAX_FORCE"]), (True, 8.5, [])):
        if clamp:
            stack.hd.hdEnable(0x4001)
        stack.hd.hdBeginFrame(stack.device)
        stack.hd.hdSetDoublev(CURRENT_FORCE, Vector3(0.0, 20.0, 0.0))
        stack.hd.hdEndFrame(stack.device)
        assert emulated.tip_state(device=stack.device).motor_n[1] == pytest.approx(expected)
        assert names(stack) == errors
    # a binding without a result type would cut the scheduler's handle, and unschedule nothing
    call = ctypes.CFUNCTYPE(ctypes.c_uint32, ctypes.c_void_p)(lambda _: 1)
    scheduled = stack.hd.hdScheduleAsynchronous(call, None, 0)
    assert scheduled > 2**32
    stack.hd.hdUnschedule(scheduled)
    assert names(stack) == []
