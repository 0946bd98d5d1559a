"""A Haptuator behind a microcontroller with a buffered converter, on a serial port."""

import time
from collections import deque
from dataclasses import asdict, dataclass
from typing import Final

import numpy as np
from pydantic import Field

from mmt.core.arrays import FloatArray
from mmt.core.errors import DeviceLost, MmtError
from mmt.devices.haptuator.board import BoardResampler, HaptuatorBoard
from mmt.devices.haptuator.driver import SILENCE_NS, HaptuatorDriver
from mmt.devices.haptuator.framing import FULL_SCALE, MOST_SAMPLES, BoardReport, BoardSamples, Reset
from mmt.devices.haptuator.options import HaptuatorOptions
from mmt.devices.haptuator.resampling import AFTER
from mmt.devices.leader_reports import ActuatorStatistics

_START_S: Final = 2.0
_REPEAT_RESET_S: Final = 0.1


class HaptuatorSerialOptions(HaptuatorOptions):
    """Options of ``haptuator-serial``."""

    port: str = Field(min_length=1)
    baud_rate: int = Field(default=1_000_000, ge=9600, le=4_000_000)
    board_rate_hz: int = Field(default=8000, ge=2000, le=48_000)
    """Rate of the board's converter; must be the rate that the board reports."""
    buffer_ms: float = Field(default=6.0, ge=2, le=200)
    """Fill of the board's buffer: how late a sample may be written."""


@dataclass(frozen=True, slots=True)
class SerialStatistics(ActuatorStatistics):
    """Counts and levels, and those of the board."""

    underruns: int
    """How often the board's buffer ran dry."""
    lost_frames: int
    """Frames that the board missed, found bad or had no room for."""
    bad_messages: int
    """Invalid frames from the board, plus the bytes that the port did not take."""
    slips: int
    """How often a board's buffer that was too full was drained at twice the speed."""
    limited_frames: int
    """Interpolated samples that were beyond the limit and were cut."""
    drift_ppm: float
    """How much faster the session's clock runs than the board's."""
    latency_ms: float | None
    """Running mean of the time from `write` to the converter, without the wire."""


class SerialHaptuator(HaptuatorDriver):
    """A `VibrationActuator` that sends samples to a board's buffer.

    The fill of the board's buffer follows from its newest report, the samples sent after that,
    and those played since; a `BoardResampler` follows it. The wire format is described in
    ``docs/reference/haptuator-framing.md``. Counts continue after a reconnection.
    """

    OPTIONS = HaptuatorSerialOptions

    def __init__(self, options: HaptuatorSerialOptions) -> None:
        super().__init__(options, float(options.board_rate_hz))
        self._options = options
        self._board = HaptuatorBoard(options.port, options.baud_rate)
        self.name = self._board.name
        self._target = round(options.buffer_ms * options.board_rate_hz / 1000.0)
        self._resampler = self._new_resampler()
        self._report = BoardReport(options.board_rate_hz, 0, 0, 0, 0, 0)
        self._report_ns = self._taken_ns = 0
        self._sequence = 0
        self._under_way: deque[tuple[int, int]] = deque()
        self._earlier = (0, 0)

    def set_rate(self, rate_hz: float) -> None:
        """Take the rate of the samples; see `RateFollowing`."""
        super().set_rate(rate_hz)
        self._resampler = self._new_resampler()

    def connect(self) -> None:
        """Open the port, empty the board's buffer and wait for its report.

        Raises
        ------
        MmtError
            The port cannot be opened, or the board does not answer or does not fit the options.
        """
        self.close()
        self._board.open()
        try:
            report = self._reset()
            self._check_settings(report)
        except Exception:
            self._board.close()
            raise
        previous = self._resampler
        self._earlier = (
            self._earlier[0] + self._report.underruns,
            self._earlier[1] + self._report.lost,
        )
        self._resampler = self._new_resampler()
        self._resampler.follower, self._resampler.slips = previous.follower, previous.slips
        self._drive.reset_filters()
        self._report, self._report_ns = report, time.monotonic_ns()
        self._taken_ns = self._report_ns
        self._sequence = 0
        self._under_way.clear()

    def _check(self) -> None:
        """Receive reports; raise `DeviceLost` if the board no longer reports or takes frames."""
        now_ns = time.monotonic_ns()
        for message in self._board.receive():
            if isinstance(message, BoardReport):
                self._take(message, now_ns)
        silent_ns = now_ns - self._report_ns
        if silent_ns > SILENCE_NS:
            raise DeviceLost(
                f"the {self.name} has reported nothing for {silent_ns / 1e6:.0f} ms: check its "
                "cable and its power"
            )
        if not self._under_way:
            self._taken_ns = now_ns
        elif now_ns - self._taken_ns > SILENCE_NS:
            raise DeviceLost(
                f"the {self.name} reports, but has taken no frame for "
                f"{(now_ns - self._taken_ns) / 1e6:.0f} ms: unplug it and plug it in again"
            )

    def _play(self, volts: list[float]) -> None:
        ahead = self._ahead(time.monotonic_ns() - self._report_ns)
        self._send(self._resampler.push(volts, ahead))
        self._note_latency(AFTER / self._rate_hz + ahead / self._options.board_rate_hz)

    def close(self) -> None:
        """Close the port; the board fades by itself. Calling it twice is harmless."""
        self._board.close()

    @property
    def statistics(self) -> SerialStatistics:
        """Counts and levels since the driver was made."""
        pusher = self._resampler
        return SerialStatistics(
            **asdict(self._drive.statistics),
            underruns=self._earlier[0] + self._report.underruns,
            lost_frames=self._earlier[1] + self._report.lost,
            bad_messages=sum(self._board.faults.values()),
            slips=pusher.slips,
            limited_frames=self._guard.limited,
            drift_ppm=round(1e6 * pusher.follower.drift, 1),
            latency_ms=self._latency_ms,
        )

    def _new_resampler(self) -> BoardResampler:
        options = self._options
        return BoardResampler(self._rate_hz, float(options.board_rate_hz), options.buffer_ms)

    def _reset(self) -> BoardReport:
        """Reset the board, and return its first report afterwards."""
        end = time.monotonic() + _START_S
        repeat = 0.0
        while (now := time.monotonic()) < end:
            if now >= repeat:
                self._board.send(Reset())
                repeat = now + _REPEAT_RESET_S
            for message in self._board.receive():
                if isinstance(message, BoardReport) and message[2:] == (0, 0, 0, 0):
                    return message
            time.sleep(0.002)
        raise MmtError(
            f"the {self.name} does not answer: check that this is its port, that its firmware "
            f"uses this framing, and 'baud_rate' ({self._options.baud_rate})"
        )

    def _check_settings(self, report: BoardReport) -> None:
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

    def _take(self, report: BoardReport, now_ns: int) -> None:
        self._report, self._report_ns = report, now_ns
        if any(sequence == report.sequence for sequence, _ in self._under_way):
            self._taken_ns = now_ns
            while self._under_way.popleft()[0] != report.sequence:
                pass

    def _ahead(self, since_report_ns: int) -> int:
        """Return the estimated number of samples that the board has yet to play."""
        under_way = sum(count for _, count in self._under_way)
        played = round(since_report_ns * 1e-9 * self._options.board_rate_hz)
        return max(0, self._report.fill + under_way - played)

    def _send(self, volts: FloatArray) -> None:
        self._guard.apply(volts)
        scale = FULL_SCALE / self._options.full_scale_v
        values = np.rint(volts * scale).astype(np.int64).tolist()
        frames = []
        for begin in range(0, len(values), MOST_SAMPLES):
            piece = tuple(values[begin : begin + MOST_SAMPLES])
            self._sequence = (self._sequence + 1) & 0xFFFF
            self._under_way.append((self._sequence, len(piece)))
            frames.append(BoardSamples(self._sequence, piece))
        self._board.send(*frames)
