"""``adxl335-board``: an ADXL335 at three inputs of an acquisition board."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Final, cast

from mmt.core.arrays import Vector
from mmt.core.errors import InputError
from mmt.devices.adxl335.sensor import BAND, Adxl335, Adxl335Options
from mmt.devices.drivers import load_device
from mmt.devices.protocols import VoltageBoard, arrival_of
from mmt.scene import Driver

NAME: Final = "adxl335-board"
RATES: Final = f"as many samples a second as its board; {BAND}"


class BoardAdxl335Options(Adxl335Options):
    """Options of a sensor at a board."""

    board: Driver
    """Driver and options of the board; its first three inputs are the sensor's X, Y, Z."""


class BoardAdxl335(Adxl335):
    """Reads three inputs of a board.

    Raises
    ------
    InputError
        The board cannot be made, or has other than three inputs.
    """

    OPTIONS = BoardAdxl335Options

    def __init__(self, options: BoardAdxl335Options) -> None:
        super().__init__(options)
        named = options.board
        self._is_open = False
        self._board: VoltageBoard = load_device(named.driver, named.options, role="board")
        if self._board.inputs != 3:
            raise InputError(
                f"{NAME}: the board is set to {self._board.inputs} inputs, the sensor needs three: "
                "give its X, Y and Z"
            )

    @property
    def arrival_ns(self) -> int:
        """Arrival time of the newest reading (ns, host's clock), or now if the board has none."""
        return arrival_of(self._board)

    def _open(self) -> None:
        self._is_open = True  # a board may hold something even if it cannot be connected
        self._board.connect()
        self._prepare(getattr(self._board, "serial", None))

    def samples(self) -> Sequence[tuple[int, Vector]]:
        """Return the new samples as (time_ns, volts along the sensor's own axes)."""
        return cast(Sequence[tuple[int, Vector]], self._board.read())

    def _explain_absence(self) -> str:
        return f"{self.name}: the board gives no voltages; check its cable and its driver's options"

    def close(self) -> None:
        """Close the board; calling it twice is harmless."""
        if self._is_open:
            self._is_open = False
            self._board.close()

    @property
    def faults(self) -> Mapping[str, int]:
        """Counts of tolerated faults, by kind, those of the board too."""
        return Counter(self._board.faults) + Counter(super().faults)
