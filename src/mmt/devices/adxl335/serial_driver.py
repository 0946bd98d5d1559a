"""``adxl335-serial``: an ADXL335 behind a microcontroller that sends frames over USB serial."""

import os
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Final

from serial.tools import list_ports

from mmt.core.arrays import Vector
from mmt.core.errors import MmtError
from mmt.devices.adxl335.framing import BoardDecoder, BoardFrame, Counts, Timeline
from mmt.devices.adxl335.sensor import BAND, Adxl335, SerialOptions
from mmt.devices.serial_ports import SerialLine, is_text

RATES: Final = f"2000 samples a second, or what its sketch is changed to; {BAND}"
_FIRST_FRAMES: Final = 3
"""Good frames that must come before the board counts as connected."""


class SerialAdxl335(Adxl335):
    """Reads the frames that ``docs/reference/accelerometer-framing.md`` describes."""

    OPTIONS = SerialOptions

    def __init__(self, options: SerialOptions) -> None:
        super().__init__(options)
        self._options = options
        self._volts_per_count = options.volts_per_count
        port = options.port
        self._line = SerialLine(f"the accelerometer's board on {port}", port, options.baud_rate)
        self._decoder = BoardDecoder()
        self._timeline = Timeline(self._counts)
        self._survived = 0  # invalid frames before the newest good one
        self._heard = bytearray()  # the newest bytes before it was connected

    def _open(self) -> None:
        self._counts.update(self._decoder.faults)
        self._timeline = Timeline(self._counts)
        self._decoder = BoardDecoder()
        self._survived = 0
        self._line.open()
        self._prepare(_serial_number(self._options.port))

    def samples(self) -> Sequence[tuple[int, Vector]]:
        """Return the new samples as (time_ns, volts along the sensor's own axes)."""
        place = self._timeline.place
        placed: list[tuple[int, Vector]] = []
        frames = self._decoder.feed(self._line.read())
        if frames:
            self._survived = self._decoder.faults.total()
        for frame in frames:
            placed.extend((time_ns, self._volts(counts)) for time_ns, counts in place(frame))
        return placed

    def _volts(self, counts: Counts) -> Vector:
        scale = self._volts_per_count
        x, y, z = counts
        return x * scale, y * scale, z * scale

    def explain_fault(self) -> str:
        """Return the problem if only invalid frames have come since the last good one, else ""."""
        broken = self._decoder.faults.total() - self._survived
        if broken <= 0:
            return ""
        return (
            f"{self._line.name} sends no good frames ({broken} were broken): check its cable, and "
            f"that the baud rate is still {self._options.baud_rate}"
        )

    def close(self) -> None:
        """Close the port; calling it twice is harmless."""
        self._line.close()

    @property
    def faults(self) -> Mapping[str, int]:
        """Counts of tolerated faults, by kind, those of the frames too."""
        return Counter(super().faults) + self._decoder.faults

    def _await_record(self) -> None:
        self._heard.clear()
        frames: list[BoardFrame] = []
        end = time.monotonic() + self._options.start_s
        while time.monotonic() < end:
            got = self._line.read()
            self._heard += got
            del self._heard[:-4096]
            frames.extend(self._decoder.feed(got))
            newest = [self._volts(frame.samples[-1]) for frame in frames[-1:]]
            if len(frames) >= _FIRST_FRAMES and self._stuck.recovers(newest):
                return
            time.sleep(0.002)
        if frames and self._stuck.is_stuck:
            raise MmtError(
                f"{self._line.name} still sends one value that never changes: check the sensor's "
                "supply and the wires to the converter"
            )
        raise MmtError(self._explain_absence())

    def _explain_absence(self) -> str:
        where, received = self._line.name, bytes(self._heard)
        if not received:
            return (
                f"{where} sent nothing for {self._options.start_s:g} s: check that the sketch of "
                "scripts/firmware is on it and that this is its port"
            )
        if self._decoder.faults["other versions"]:
            return f"{where} sends frames of another version: put the present sketch on it"
        if is_text(received):
            return f"{where} sends text: another sketch runs on it; put that of scripts/firmware on"
        return (
            f"{where} sent {len(received)} bytes or more but no good frames: the baud rate is "
            f"probably not {self._options.baud_rate} (option baud_rate; the sketch says which), or "
            "another sketch runs on it"
        )


def _serial_number(port: str) -> str | None:
    """Return the serial number that the board at a port reports over USB, or None."""
    here = os.path.realpath(port)
    for info in list_ports.comports():
        if os.path.realpath(info.device) == here:
            number: str | None = info.serial_number
            return number
    return None
