"""A Haptuator's board on an emulated port: its clock, and what goes wrong."""

import errno
import math
import time

import numpy as np
import pytest
import serial
from hypothesis import given, settings
from hypothesis import strategies as st

pty = pytest.importorskip("pty", reason="the emulated port is a pseudo-terminal")

from waiting import check_refused  # noqa: E402

from mmt.core.errors import DeviceLost, InputError  # noqa: E402
from mmt.devices.drivers import load_device  # noqa: E402
from mmt.devices.haptuator.board import BoardResampler  # noqa: E402
from mmt.devices.haptuator.framing import FULL_SCALE  # noqa: E402
from mmt.devices.haptuator.serial_driver import SerialHaptuator  # noqa: E402
from mmt.testing.emulated.haptuator_board import EmulatedHaptuatorBoard  # noqa: E402


def resampled(rate_hz, signal, *, ahead=0.0, board_ppm=0.0):
    """Push a signal a millisecond at a time to a board of 8 kHz.

    Return the resampler, what was played, and how much was waiting before each push.
    """
    pusher, played, fills = BoardResampler(rate_hz, 8000.0, 6.0), [], []
    for tick in np.reshape(signal, (-1, round(rate_hz / 1000.0))).tolist():
        fills.append(ahead)
        played.append(pusher.push(tick, math.floor(ahead)))
        ahead = max(0.0, ahead + len(played[-1]) - 8.0 * (1.0 + 1e-6 * board_ppm))
    return pusher, np.concatenate(played), [*fills, ahead]


def tone(hz, rate_hz, seconds):
    return np.sin(2.0 * np.pi * hz * np.arange(round(rate_hz * seconds)) / rate_hz)


@pytest.mark.parametrize("board_ppm", [-1000.0, 0.0, 300.0])
def test_a_boards_drift_is_learnt_and_the_signal_stays_whole(board_ppm):
    pusher, played, fills = resampled(1000.0, tone(200.0, 1000.0, 20.0), board_ppm=board_ppm)
    assert np.max(np.abs(np.diff(played))) < 1.1 * 2.0 * np.pi * 200.0 / 8000.0
    assert np.mean(fills[-5000:]) == pytest.approx(48.0, abs=4.0)
    assert min(fills[1:]) > 16.0
    assert pusher.follower.drift == pytest.approx(-1e-6 * board_ppm, abs=2e-4)
    assert pusher.slips == 0


@pytest.mark.parametrize("k", [2, 5, 8])
def test_a_faster_signal_reaches_the_board_as_it_is(k):
    pusher, played, _ = resampled(1000.0 * k, tone(200.0 * k, 1000.0 * k, 4.0))
    heard = played[-8000:]
    assert np.argmax(np.abs(np.fft.rfft(heard * np.hanning(8000)))) == pytest.approx(200 * k, abs=2)
    assert np.std(heard) == pytest.approx(math.sqrt(0.5), rel=0.03)
    assert pusher.slips == 0


def test_a_buffer_that_is_far_too_full_is_caught_up_with_smoothly():
    pusher, played, fills = resampled(1000.0, tone(100.0, 1000.0, 1.0), ahead=400.0)
    assert pusher.slips == 1
    assert fills[-1] < 80.0
    assert np.max(np.abs(np.diff(played))) < 2.3 * 2.0 * np.pi * 100.0 / 8000.0


@settings(max_examples=40)
@given(st.lists(st.tuples(st.integers(0, 3000), st.integers(0, 2000)), max_size=30))
def test_whatever_is_held_up_the_board_gets_finite_bounded_samples(turns):
    pusher = BoardResampler(1000.0, 8000.0, 6.0)
    for count, ahead in turns:
        block = pusher.push([1.0] * count, ahead)
        assert np.all(np.abs(block) <= 1.5)


@pytest.fixture
def board(started):
    return started(EmulatedHaptuatorBoard(clock_ppm=200.0))


def haptuator(board, **changes):
    options = {"volts_per_m_s2": 0.1, "full_scale_v": 6.0, "port": board.path, "buffer_ms": 50.0}
    device = load_device("haptuator-serial", {**options, **changes})
    assert isinstance(device, SerialHaptuator)
    return device


@pytest.fixture
def device(board, connected):
    return connected(haptuator(board))


def play(device, until, patience_s=20.0):
    """Play a tone of 200 Hz and 10 m/s2 in real time until something holds."""
    begin, written = time.monotonic(), 0
    while not until():
        now = time.monotonic() - begin
        assert now < patience_s
        due = int(1000.0 * now) - written
        if due > 20:  # this machine was busy: nothing is made up, it would not fit
            begin, due = begin + (due - 20) / 1000.0, 20
        if due > 0:
            device.write(
                [10.0 * math.sin(0.4 * math.pi * k + 0.3) for k in range(written, written + due)]
            )
            written += due
        time.sleep(0.001)


def test_a_tone_reaches_the_converter_at_its_level(board, device):
    device.calibrate()
    play(device, lambda: device.statistics.samples > 700)
    volts = np.array(board.played()[-2400:-800]) * 6.0 / FULL_SCALE
    levels = np.sqrt(np.mean(volts.reshape(-1, 80) ** 2, axis=1))  # some silent where it was late
    assert np.median(levels) == pytest.approx(math.sqrt(0.5), rel=0.05)
    statistics = device.statistics
    assert (statistics.bad_messages, statistics.clipped) == (0, 0)
    assert statistics.lost_frames < 35  # of seven hundred: the board's thread may be late
    assert 40.0 < statistics.latency_ms < 90.0
    device.close()
    device.close()


def test_a_board_that_is_unplugged_or_hangs_is_lost_and_connected_again(board, device):
    def plays_on(samples=100):
        before = device.statistics.samples
        play(device, lambda: device.statistics.samples > before + samples)

    plays_on()
    board.unplug()
    with pytest.raises(DeviceLost, match="plug it in again"):
        play(device, lambda: False)
    check_refused(device.connect, "plug the board in")
    check_refused(lambda: device.write([1.0]), "closed", DeviceLost)
    board.plug()
    device.connect()
    assert device.statistics.samples >= 100
    plays_on()
    board.frozen = True
    with pytest.raises(DeviceLost, match="reports, but has taken no frame"):
        play(device, lambda: False)
    board.frozen = False
    device.connect()
    plays_on(700)
    board.stalled = True
    with pytest.raises(DeviceLost, match="reported nothing"):
        play(device, lambda: False)
    check_refused(device.connect, "does not answer")


@pytest.mark.parametrize("fault", ["garbled", "halved"])
def test_garbled_and_half_frames_are_counted_and_survived(board, device, fault):
    device._sequence = 65_500  # and the number of a frame begins again, as it does after 65 s
    board.count_from(65_500)
    play(device, lambda: device.statistics.samples > 700)
    assert device.statistics.lost_frames == 0
    setattr(board, fault, 0.1)
    play(device, lambda: device.statistics.lost_frames > 3 and device.statistics.bad_messages > 3)
    setattr(board, fault, 0.0)
    samples = device.statistics.samples
    play(device, lambda: device.statistics.samples > samples + 300)
    assert max(map(abs, board.played()[-1600:])) > 0.9 / 6.0 * FULL_SCALE


def test_a_board_that_restarts_by_itself_plays_on(board, device):
    play(device, lambda: device.statistics.samples > 300)
    board.restart()
    samples = device.statistics.samples

    def at_its_level():  # a busy machine's gaps lower it meanwhile
        level = np.sqrt(np.mean((np.array(board.played()[-2400:-800]) * 6.0 / FULL_SCALE) ** 2))
        return device.statistics.samples > samples + 700 and abs(level - math.sqrt(0.5)) < 0.07

    play(device, at_its_level)


def test_what_cannot_be_is_explained(board, monkeypatch):
    check_refused(haptuator(board, board_rate_hz=16_000).connect, "set 'board_rate_hz'")
    check_refused(haptuator(board, buffer_ms=100).connect, "make it smaller")
    with pytest.raises(InputError, match="port"):
        haptuator(board, port="")

    def refuse(*_, **__):
        raise serial.SerialException(errno.EACCES, "could not open port: Permission denied")

    monkeypatch.setattr(serial, "Serial", refuse)
    check_refused(haptuator(board).connect, r"no permission.*dialout")
