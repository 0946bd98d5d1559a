"""The emulated HD library keeps the rules of the real one, so that a driver learns them."""

import ctypes
import threading
import time

import pytest
from emulated_arm import emulated_arm  # noqa: F401 - a fixture

from mmt.core.errors import MmtError
from mmt.devices.openhaptics.library import (
    CALLBACK,
    CURRENT_FORCE,
    CURRENT_POSITION,
    DONE,
    FORCE_OUTPUT,
    Vector3,
    name_of,
    open_stack,
)
from mmt.testing.emulated.openhaptics.hd import build_library


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
    assert names(stack) == ["BAD_HANDLE", "ILLEGAL_END", "ILLEGAL_BEGIN"]
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


def test_what_is_unknown_is_refused(stack):
    stack.hd.hdGetDoublev(0x1234, Vector3())
    stack.hd.hdEnable(0x1234)
    stack.hd.hdUpdateCalibration(1)
    stack.hd.hdUnschedule(5)
    assert names(stack) == ["INVALID_VALUE", "INVALID_INPUT_TYPE", "INVALID_ENUM", "INVALID_ENUM"]


def test_a_wall_stops_the_tip_and_a_hand_moves_it(stack, emulated):
    emulated.wall(-1.0, 2.0, device=stack.device)
    emulated.hold((0.0, -21.0, 0.0), 0.1, device=stack.device)
    stack.hd.hdStartScheduler()
    wanted = emulated.ticks + 3000
    position = Vector3()
    while emulated.ticks < wanted:
        stack.hd.hdGetDoublev(CURRENT_POSITION, position)
        if abs(position[1] + 1.0 + 20.0 * 0.1 / 2.1) < 0.01 and emulated.tip_state(
            device=stack.device
        ).velocity_mm_s[1] == pytest.approx(0.0, abs=0.01):
            break
    else:
        pytest.fail(f"the tip is at {position[1]} mm")
    stack.hd.hdStopScheduler()


def test_its_own_processor_time_is_told_without_that_of_callbacks(stack, emulated):
    spent = threading.Event()

    def spend(_):
        end_ns = time.thread_time_ns() + 200_000_000
        while time.thread_time_ns() < end_ns:
            pass
        spent.set()
        return DONE

    began_ns = emulated.own_ns
    callback = CALLBACK(spend)
    stack.hd.hdScheduleAsynchronous(callback, None, 0)
    stack.hd.hdStartScheduler()
    assert spent.wait(30.0)
    wanted = emulated.ticks + 20
    while emulated.ticks < wanted:
        time.sleep(0.001)
    stack.hd.hdStopScheduler()
    assert 0 < emulated.own_ns - began_ns < 150_000_000


def test_a_compiler_that_is_missing_or_fails_is_explained(tmp_path, monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(MmtError, match="install a C compiler"):
        build_library(tmp_path)
    monkeypatch.setenv("CC", "false")
    with pytest.raises(MmtError, match="cannot compile the emulated OpenHaptics device"):
        build_library(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_handle_of_the_scheduler_is_wider_than_32_bits(stack):
    """A binding without a result type would cut it, and unschedule nothing."""
    call = ctypes.CFUNCTYPE(ctypes.c_uint32, ctypes.c_void_p)(lambda _: 1)
    scheduled = stack.hd.hdScheduleAsynchronous(call, None, 0)
    assert scheduled > 2**32
    stack.hd.hdUnschedule(scheduled)
    assert names(stack) == []
