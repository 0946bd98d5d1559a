"""A Haptuator behind a microcontroller with a buffered converter, on a serial port."""

import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from pydantic import Field

from mmt.arrays import FloatArray
from mmt.devices.haptuator.board import HaptuatorBoard
from mmt.devices.haptuator.drive import VoltageDrive
from mmt.devices.haptuator.framing import FULL_SCALE, MOST_SAMPLES, Report, Reset, Samples
from mmt.devices.haptuator.interpolation import AFTER
from mmt.devices.haptuator.options import HaptuatorOptions
from mmt.devices.haptuator.pushing import Pusher
from mmt.devices.loading import read_options
from mmt.devices.protocols import ActuatorStatistics
from mmt.errors import DeviceLost, MmtError

DRIVER: Final = "haptuator-serial"

_RATE_HZ: Final = 1000.0
"""Of the session, which has no other."""
_SILENCE_NS: Final = 500_000_000
_START_S: Final = 2.0
_REPEAT_RESET_S: Final = 0.1
_SMOOTHING: Final = 0.02


class SerialOptions(HaptuatorOptions):
    """Options of ``haptuator-serial``."""

    port: str = Field(min_length=1)
    baud_rate: int = Field(default=1_000_000, ge=9600, le=4_000_000)
    board_rate_hz: int = Field(default=8000, ge=2000, le=48_000)
    """Of the board's converter; the board says its own, which must be this."""
    buffer_ms: float = Field(default=6.0, ge=2, le=200)
    """Kept in the board's buffer: how late a sample may be written."""


@dataclass(frozen=True, slots=True)
class SerialStatistics(ActuatorStatistics):
    """Counts and levels, and how the board went along."""

    underruns: int
    """How often the board's buffer ran dry."""
    lost_frames: int
    """Frames that the board missed, found bad or had no room for."""
    bad_messages: int
    """What came from the board and was no message."""
    slips: int
    """How often a board's buffer that was too full was caught up with at twice the speed."""
    limited_frames: int
    """Samples that went beyond the limit between those of the session and were cut."""
    drift_ppm: float
    """How much faster the session's clock runs than the board's."""
    latency_ms: float | None
    """From writing a sample to the converter, the mean of the last ones; without the wire."""


def haptuator_serial(**options: Any) -> "SerialHaptuator":
    """Make the driver; see `SerialOptions`.

    Raises
    ------
    InputError
        An option is not allowed.
    """
    return SerialHaptuator(read_options(SerialOptions, DRIVER, options))


class SerialHaptuator:
    """A `VibrationActuator` that sends samples to a board's buffer.

    How far the board's buffer is filled is known from its newest report, from what was sent after
    that, and from what has been played since; a `Pusher` follows it. The wire is described in
    ``docs/reference/haptuator-framing.md``. Counts go on when it is connected again.
    """

    def __init__(self, options: SerialOptions) -> None:
        self._options = options
        self._board = HaptuatorBoard(options.port, options.baud_rate)
        self.port = options.port
        self.name = self._board.name
        self._drive = VoltageDrive(options, _RATE_HZ)
        self._target = round(options.buffer_ms * options.board_rate_hz / 1000.0)
        self._pusher = self._new_pusher()
        self._report = Report(options.board_rate_hz, 0, 0, 0, 0, 0)
        self._report_ns = self._taken_ns = 0
        self._sequence = 0
        self._under_way: deque[tuple[int, int]] = deque()
        self._earlier = (0, 0)
        self._limited = 0
        self._latency_s: float | None = None

    def connect(self) -> None:
        """Open the port, empty the board's buffer and wait for its report.

        Raises
        ------
        MmtError
            The port cannot be opened, the board does not answer, or has another rate.
        """
        self.close()
        self._board.open()
        try:
            report = self._reset()
            self._check(report)
        except Exception:
            self._board.close()
            raise
        previous = self._pusher
        self._earlier = (
            self._earlier[0] + self._report.underruns,
            self._earlier[1] + self._report.lost,
        )
        self._pusher = self._new_pusher()
        self._pusher.follower, self._pusher.slips = previous.follower, previous.slips
        self._drive.rest()
        self._report, self._report_ns = report, time.monotonic_ns()
        self._taken_ns = self._report_ns
        self._sequence = 0
        self._under_way.clear()

    def calibrate(self) -> None:
        """Do nothing: what the actuator makes of a volt is an option."""

    def write(self, samples_m_s2: Sequence[float] | FloatArray) -> None:
        """Play samples (n,), m/s2; never blocks.

        Raises
        ------
        DeviceLost
            The board was unplugged, reports nothing any more, or takes nothing any more.
        """
        ahead = self._prepare()
        self._play(self._drive.convert(samples_m_s2), ahead)

    @property
    def largest_v(self) -> float:
        """Largest voltage (V) that the actuator may get."""
        return self._options.largest_v

    def write_volts(self, volts: Sequence[float] | FloatArray) -> None:
        """Play voltages (n,), V, as they are; see `VoltageActuator`.

        Raises
        ------
        DeviceLost
            The board was unplugged, or reports nothing any more.
        """
        ahead = self._prepare()
        self._play(self._options.cut(volts), ahead)

    def _prepare(self) -> int:
        """Hear the board, and return how many samples lie before its converter."""
        now_ns = time.monotonic_ns()
        for message in self._board.receive():
            if isinstance(message, Report):
                self._take(message, now_ns)
        silent_ns = now_ns - self._report_ns
        if silent_ns > _SILENCE_NS:
            raise DeviceLost(
                f"the {self.name} has reported nothing for {silent_ns / 1e6:.0f} ms: check its "
                "cable and its power"
            )
        if not self._under_way:
            self._taken_ns = now_ns
        elif now_ns - self._taken_ns > _SILENCE_NS:
            raise DeviceLost(
                f"the {self.name} reports, but has taken no frame for "
                f"{(now_ns - self._taken_ns) / 1e6:.0f} ms: unplug it and plug it in again"
            )
        return self._ahead(silent_ns)

    def _play(self, volts: list[float], ahead: int) -> None:
        self._send(self._pusher.push(volts, ahead))
        self._note_latency(ahead)

    def close(self) -> None:
        """Close the port; the board fades by itself. Calling it twice is harmless."""
        self._board.close()

    @property
    def statistics(self) -> SerialStatistics:
        """Counts and levels since it was made."""
        drive, pusher, latency_s = self._drive.statistics, self._pusher, self._latency_s
        return SerialStatistics(
            samples=drive.samples,
            clipped=drive.clipped,
            rms_m_s2=drive.rms_m_s2,
            peak_m_s2=drive.peak_m_s2,
            underruns=self._earlier[0] + self._report.underruns,
            lost_frames=self._earlier[1] + self._report.lost,
            bad_messages=sum(self._board.faults.values()),
            slips=pusher.slips,
            limited_frames=self._limited,
            drift_ppm=round(1e6 * pusher.follower.drift, 1),
            latency_ms=None if latency_s is None else round(1e3 * latency_s, 2),
        )

    def _new_pusher(self) -> Pusher:
        return Pusher(_RATE_HZ, float(self._options.board_rate_hz), self._options.buffer_ms)

    def _reset(self) -> Report:
        """Have the board begin anew, and return its first report after that."""
        end = time.monotonic() + _START_S
        repeat = 0.0
        while (now := time.monotonic()) < end:
            if now >= repeat:
                self._board.send(Reset())
                repeat = now + _REPEAT_RESET_S
            for message in self._board.receive():
                if isinstance(message, Report) and message[2:] == (0, 0, 0, 0):
                    return message
            time.sleep(0.002)
        raise MmtError(
            f"the {self.name} does not answer: check that this is its port, that its firmware "
            f"speaks this framing, and 'baud_rate' ({self._options.baud_rate})"
        )

    def _check(self, report: Report) -> None:
        if report.rate_hz != self._options.board_rate_hz:
            raise MmtError(
                f"the {self.name} plays {report.rate_hz} samples a second: set 'board_rate_hz' to "
                f"that, it is {self._options.board_rate_hz}"
            )
        if report.capacity < 2 * self._target:
            raise MmtError(
                f"the {self.name} holds {report.capacity} samples, 'buffer_ms' "
                f"{self._options.buffer_ms:g} asks for twice {self._target}: make it smaller"
            )

    def _take(self, report: Report, now_ns: int) -> None:
        self._report, self._report_ns = report, now_ns
        if any(sequence == report.sequence for sequence, _ in self._under_way):
            self._taken_ns = now_ns
            while self._under_way.popleft()[0] != report.sequence:
                pass

    def _ahead(self, since_report_ns: int) -> int:
        """Return how many samples lie before the board's converter, as far as is known."""
        under_way = sum(count for _, count in self._under_way)
        played = round(since_report_ns * 1e-9 * self._options.board_rate_hz)
        return max(0, self._report.fill + under_way - played)

    def _send(self, volts: FloatArray) -> None:
        options = self._options
        beyond = int(np.count_nonzero(np.abs(volts) > options.largest_v))
        if beyond:
            self._limited += beyond
            np.clip(volts, -options.largest_v, options.largest_v, out=volts)
        values = np.rint(volts * (FULL_SCALE / options.full_scale_v)).astype(np.int64).tolist()
        frames = []
        for begin in range(0, len(values), MOST_SAMPLES):
            piece = tuple(values[begin : begin + MOST_SAMPLES])
            self._sequence = (self._sequence + 1) & 0xFFFF
            self._under_way.append((self._sequence, len(piece)))
            frames.append(Samples(self._sequence, piece))
        self._board.send(*frames)

    def _note_latency(self, ahead: int) -> None:
        latency_s = AFTER / _RATE_HZ + ahead / self._options.board_rate_hz
        known = self._latency_s
        self._latency_s = latency_s if known is None else known + _SMOOTHING * (latency_s - known)
