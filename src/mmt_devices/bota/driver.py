"""``bota-serial``: a force sensor by Bota Systems on a serial line."""

import time
from collections import Counter
from typing import Final, Literal, Self

from pydantic import Field, model_validator

from mmt.core.errors import MmtError
from mmt.devices.record_clocks import StampClock
from mmt.devices.sensor_drivers import Stamped, WrenchSensor
from mmt.devices.serial_ports import SerialLine, is_text
from mmt.devices.wrench import Positive, WrenchOptions, diagonal
from mmt_devices.bota.frames import (
    ANSWER,
    CONFIGURE,
    INVALID,
    OVERRANGE,
    RAW,
    RUN,
    SIZE,
    SKIPPED,
    FrameStream,
    filter_command,
    frame_rate_hz,
    most_frames_hz,
    setup_command,
)

_ANSWER_S: Final = 0.5
_ATTEMPTS: Final = 4
"""Number of attempts, enough for a sensor that was just switched on to start up."""
_BETWEEN_BYTES_S: Final = 0.005
"""Pause between bytes of a command, as in the vendor's driver; commands have no end mark."""
_KEPT: Final = 8192


_FRAME_BITS: Final = 10 * SIZE
_WORDS: Final = {
    INVALID: "that its measurements are invalid (a gauge in saturation, short or open)",
    RAW: "values of its gauges in the place of forces",
}


class NoAnswer(MmtError):  # noqa: N818 - its message names what came
    """The sensor has not answered a command."""


class BotaLine(SerialLine):
    """Line to a sensor; see `SerialLine`."""

    def __init__(self, name: str, port: str, baud: int) -> None:
        super().__init__(name, port, baud, write_timeout=1)
        self.received = bytearray()
        """Newest bytes received, for explaining faults."""

    def open(self) -> None:
        """Open the port; see `SerialLine`."""
        super().open()
        self.received.clear()

    def note(self, content: bytes) -> None:
        """Add bytes to `received`, of which the newest are kept."""
        self.received += content
        del self.received[:-_KEPT]

    def command(self, command: str) -> None:
        """Send a command and await its answer; frames that arrive meanwhile are discarded.

        Raises
        ------
        NoAnswer
            No answer came in four attempts.
        MmtError
            The sensor refuses the command.
        """
        for _ in range(_ATTEMPTS):
            self.note(self.read())
            self._send(command)
            code = self._await_answer(command[0])
            if code == "0":
                return
            if code:
                raise MmtError(
                    f"{self.name}: it refuses the command {command!r} (code {code}): "
                    "switch it off and on, or leave its settings with configure = false"
                )
        raise NoAnswer(f"{self.name}: it does not answer the command {command!r}")

    def _send(self, command: str) -> None:
        for character in command:
            self.write(character.encode("ascii"))
            time.sleep(_BETWEEN_BYTES_S)

    def _await_answer(self, command: str) -> str:
        """Return the code of the answer to a command, empty if none came."""
        received = b""
        end = time.monotonic() + _ANSWER_S
        while time.monotonic() < end:
            content = self.read()
            self.note(content)
            received += content
            for answer in ANSWER.finditer(received):
                if answer[1] == command.encode("ascii"):
                    return answer[2].decode("ascii")
            time.sleep(0.001)
        return ""


class BotaOptions(WrenchOptions):
    """Options of ``bota-serial``."""

    port: str = Field(min_length=1)
    """Serial port, as ``/dev/serial/by-id/usb-FTDI_...``."""
    baud: Literal[460_800, 230_400, 115_200, 57_600, 9600] = 460_800
    """Bits a second that the sensor is set to."""
    configure: bool = True
    """Whether to set filter, calibrated forces and binary frames; if not, they stay as they are."""
    sinc_length: int = Field(default=51, ge=51, le=512)
    """Length of its sinc filter: 51200 / length frames a second."""
    fir: bool = False
    """Whether the sensor's FIR filter follows the sinc filter, at 252 Hz for a length of 51."""
    range_n: tuple[Positive, Positive, Positive] = (100.0, 100.0, 100.0)
    """Range of Fx, Fy, Fz (N), from the model's data sheet."""
    range_n_m: tuple[Positive, Positive, Positive] = (10.0, 10.0, 10.0)
    """Range of Tx, Ty, Tz (N m), likewise."""
    start_s: float = Field(default=2.0, ge=0.2, le=30.0)
    """How long the first frame may take."""

    @model_validator(mode="after")
    def _fit_the_line(self) -> Self:
        frames_hz, most_hz = frame_rate_hz(self.sinc_length), most_frames_hz(self.baud)
        if self.configure and frames_hz > most_hz:
            raise ValueError(
                f"sinc_length {self.sinc_length} gives {frames_hz:.0f} frames a second, of which "
                f"{self.baud} baud carry {most_hz:.0f}: raise 'sinc_length', or set the sensor to "
                "a higher 'baud'"
            )
        return self


class BotaSerial(WrenchSensor):
    """`SampledSensor` of forces, stamped by the sensor's own clock."""

    OPTIONS = BotaOptions

    def __init__(self, options: BotaOptions) -> None:
        super().__init__(f"Bota sensor at {options.port}", options)
        self._options, self._first_s = options, options.start_s
        self._line = BotaLine(self.name, options.port, options.baud)
        self._stream = FrameStream(self._counts)
        self._clock = StampClock(self._counts)
        self._status = 0  # of the newest frame that could not be used
        self._set_latency(1e9 * _FRAME_BITS / options.baud)
        x, y, z = options.range_n_m
        limits = (*options.range_n, 1000.0 * x, 1000.0 * y, 1000.0 * z)
        self._set_matrix(diagonal(1.0, 1000.0), limits)

    def _open(self) -> None:
        """Open the port, and set the sensor up if the options say so."""
        self._line.open()
        self._set_up()
        self._stream.reset()
        self._clock.interrupt()
        self._status = 0
        self._line.received.clear()

    def close(self) -> None:
        """Close the port; the sensor goes on sending. Calling it twice is harmless."""
        self._line.close()

    def _set_up(self) -> None:
        """Set communication and filter; the sensor loses both when it is switched off."""
        options, line = self._options, self._line
        if not options.configure:
            return
        try:
            line.command(CONFIGURE)
            line.command(setup_command(options.baud))
            line.command(filter_command(options.sinc_length, fir=options.fir))
            line.command(RUN)
        except NoAnswer as error:
            raise MmtError(f"{error}; {self._explain()}") from error

    def _explain_absence(self) -> str:
        if self._status:
            return self._explain_status()
        start_s = self._options.start_s
        return f"{self.name}: no frame could be used in {start_s:g} s; {self._explain()}"

    def _explain(self) -> str:
        """Return what came instead of frames, and what to do."""
        received = bytes(self._line.received)
        if not received:
            return f"nothing comes; {self._where()}"
        if FrameStream(Counter()).feed(received):
            return (
                "its frames come, but what is sent to it does not arrive: check the wires from the "
                "adapter to it (RS-422: TX+ and TX-), or leave its settings with configure = false"
            )
        if is_text(received):
            return "text comes: set its data format to binary, which configure = true does"
        return (
            f"{len(received)} bytes or more came but no good frames: the baud rate is probably not "
            f"{self._options.baud} (option baud: 460800, 230400, 115200, 57600 or 9600), or the "
            "model speaks another protocol"
        )

    def _where(self) -> str:
        return "check its power, its cable, and that this is its port"

    def _receive(self, now_ns: int) -> list[Stamped]:
        content = self._line.read()
        if not content:
            return []
        self._line.note(content)
        records: list[Stamped] = []
        for status, wrench, time_us, _ in self._stream.feed(content):
            time_ns = self._clock.stamp(time_us, now_ns)
            if time_ns is None or (status and not self._is_usable(status)):
                continue
            records.append((time_ns, wrench))
        if records:
            self._status = 0
        else:
            self._useless_ns = now_ns
        return records

    def _is_usable(self, status: int) -> bool:
        """Count the faults in a frame's status; return whether the frame is usable."""
        if status & SKIPPED:
            self._counts["skipped measurements"] += 1
        if status & OVERRANGE:
            self._counts["overrange"] += 1
            self._tell_overload()
        if status & INVALID:
            self._counts["invalid measurements"] += 1
        if status & RAW:
            self._counts["raw measurements"] += 1
        if status & (INVALID | RAW):
            self._status = status
            return False
        return True

    def _explain_unusable(self) -> str:
        if self._status:
            return self._explain_status()
        return (
            f"{self.name}: no frame could be used ({self._counts['broken frame']} broken so far): "
            f"check its cable and shield, and that the baud rate is still {self._options.baud}"
        )

    def _explain_status(self) -> str:
        words = " and ".join(word for bit, word in _WORDS.items() if self._status & bit)
        advice = (
            "unload it, and switch it off and on; it may be damaged"
            if self._status & INVALID
            else "switch its calibration matrix on, which configure = true does"
        )
        return f"{self.name}: the sensor reports {words}: {advice}"
