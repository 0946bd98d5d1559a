"""The stream of a LabJack U6: packets from USB, decoded when they are read."""

from collections import Counter
from typing import Any

from mmt.core.errors import MmtError
from mmt.devices.board_sharing import ChannelsOf, StreamData
from mmt.devices.labjack.packets import (
    READ_CALIBRATION,
    STREAM_CONFIG,
    AnalogInput,
    plan,
    stream_config,
)
from mmt.devices.labjack.scans import BLOCKS, CentredLines, StreamDecoder, read_lines
from mmt.devices.labjack.usb_link import U6Link


class U6Stream:
    """A `BoardStream`.

    Parameters
    ----------
    box
        Serial number of the U6; None takes the only one.
    backend
        The pyusb backend; None takes the one that the system has.
    rate_hz
        Scans a second.
    channels_of
        Returns the inputs to scan.

    Raises
    ------
    MmtError
        The U6 is missing, may not be opened, or refuses a command.
    """

    def __init__(
        self, box: int | None, backend: Any, rate_hz: float, channels_of: ChannelsOf[AnalogInput]
    ) -> None:
        self._link = link = U6Link(box, backend)
        try:
            link.open()
            self.board = link.serial
            self.serial = f"u6-{link.serial}"
            scanning = plan(channels_of(link.serial), rate_hz)
            self._decoder = StreamDecoder(scanning, _calibration(link))
            link.send(stream_config(scanning), STREAM_CONFIG)
            link.start()
        except BaseException:
            link.close()
            raise

    @property
    def is_streaming(self) -> bool:
        """Whether packets are still arriving."""
        return self._link.is_streaming

    def read_scans(self) -> StreamData:
        """Decode the received packets; see `BoardStream`."""
        packets, decoder = self._link.packets(), self._decoder
        scans = [scan for _, raw in packets for scan in decoder.decode(raw)]
        faults, decoder.faults = decoder.faults, Counter()
        return StreamData(scans, packets[-1][0] if packets else 0, faults)

    def close(self) -> None:
        """End the stream and release the U6; calling it twice is harmless."""
        self._link.close()


def _calibration(link: U6Link) -> tuple[CentredLines, ...]:
    blocks = [link.ask(READ_CALIBRATION, bytes((0, number))) for number in range(BLOCKS)]
    try:
        return read_lines(blocks)
    except ValueError as error:
        raise MmtError(f"the LabJack U6 is not calibrated: {error}") from error
