"""An emulated Phantom or Touch, behind a library with the interface of libHD."""

import ctypes
import hashlib
import os
import shutil
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple, get_args

import platformdirs

from mmt.core.arrays import Vector
from mmt.core.errors import MmtError

_SOURCES: Final = tuple(
    Path(__file__).with_name(name) for name in ("hd_stub.c", "hd_stub_world.c", "hd_stub.h")
)
_FLAGS: Final = ("-O2", "-std=gnu11", "-shared", "-fPIC", "-pthread")
_COMPILERS: Final = ("cc", "gcc", "clang")
_PATIENCE_S: Final = 60.0
_HAND_PERIOD_S: Final = 0.002

Fault = Literal["absent", "comm_lost", "warm", "fault", "stalled", "unlicensed", "garbled", "stuck"]
_FAULTS: Final[tuple[Fault, ...]] = get_args(Fault)

_Three: Final = ctypes.c_double * 3
_Nine: Final = ctypes.c_double * 9


def build_library() -> Path:
    """Compile the emulated library, in the user's cache, unless that is done; return its path.

    Raises
    ------
    MmtError
        There is no C compiler, or it fails.
    """
    source = b"".join(path.read_bytes() for path in _SOURCES)
    directory = platformdirs.user_cache_path("mmt-haptics", appauthor=False)
    library = directory / f"emulated-hd-{hashlib.sha256(source).hexdigest()[:16]}.so"
    if library.exists():
        return library
    names = [os.environ["CC"]] if os.environ.get("CC") else _COMPILERS
    compiler = next((found for name in names if (found := shutil.which(name))), None)
    if compiler is None:
        raise MmtError("the emulated OpenHaptics device is compiled: install a C compiler (gcc)")
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=directory) as folder:
            made = Path(folder) / library.name
            subprocess.run(  # noqa: S603 - our own source, by the compiler of this machine
                [compiler, *_FLAGS, *map(str, _SOURCES[:-1]), "-o", str(made), "-lm"],
                check=True, capture_output=True, text=True, timeout=_PATIENCE_S,
            )  # fmt: skip
            made.replace(library)
    except (OSError, subprocess.SubprocessError) as error:
        reason = getattr(error, "stderr", None) or str(error)
        raise MmtError(
            f"{compiler} cannot compile the emulated OpenHaptics device: {reason}"
        ) from error
    return library


class EmulatedTipState(NamedTuple):
    """One emulated tip, in HD's axes."""

    position_mm: Vector
    velocity_mm_s: Vector
    motor_n: Vector


class EmulatedHd:
    """The emulated devices of this process: up to two, in the order in which they were opened.

    Drivers load the library at `address`. Each tip is a mass of 75 g with 0.5 N s/m of damping
    (our choice, of the order of a small arm), in HD's axes.

    Parameters
    ----------
    truth
        Gives the place (mm) at which a hand holds the first tip at a monotonic time (ns);
        None lets it move freely.
    hand_n_mm
        Stiffness of that hand.
    """

    def __init__(
        self, truth: Callable[[int], Vector] | None = None, *, hand_n_mm: float = 0.3
    ) -> None:
        self.address = str(build_library())
        self._stub: Any = ctypes.CDLL(self.address)
        doubles = ctypes.POINTER(ctypes.c_double)
        self._stub.mmt_stub_limits.argtypes = [ctypes.c_double, ctypes.c_double]
        self._stub.mmt_stub_hand.argtypes = [ctypes.c_uint, ctypes.c_int, doubles, ctypes.c_double]
        self._stub.mmt_stub_wall.argtypes = [
            ctypes.c_uint, ctypes.c_int, ctypes.c_double, ctypes.c_double,
        ]  # fmt: skip
        self._stub.mmt_stub_place.argtypes = [ctypes.c_uint, doubles]
        self._stub.mmt_stub_turn.argtypes = [ctypes.c_uint, doubles]
        self._stub.mmt_stub_look.argtypes = [ctypes.c_uint, doubles]
        self._stub.mmt_stub_ticks.restype = ctypes.c_ulong
        self._stub.mmt_stub_own_ns.restype = ctypes.c_longlong
        self._truth, self._hand_n_mm = truth, hand_n_mm
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Start again: tips at rest at zero, no fault, calibrated; the hand begins to move."""
        self.stop()
        self._stub.mmt_stub_reset()
        if self._truth is not None:
            self._ended.clear()
            self._thread = threading.Thread(target=self._move, args=(self._truth,), daemon=True)
            self._thread.start()

    def stop(self) -> None:
        """Stop the hand and release the tip."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
            self.release()

    def _move(self, truth: Callable[[int], Vector]) -> None:
        while not self._ended.wait(_HAND_PERIOD_S):
            self.hold(truth(time.monotonic_ns()), self._hand_n_mm)

    # --- faults

    def fail(self, fault: Fault, *, on: bool = True) -> None:
        """Start or end a fault."""
        self._stub.mmt_stub_fault(_FAULTS.index(fault), int(on))

    def unplug(self) -> None:
        """Have the device not answer any more."""
        self.fail("comm_lost")

    def plug(self) -> None:
        """Have the device answer again."""
        self.fail("comm_lost", on=False)

    def stall(self, *, on: bool = True) -> None:
        """Stop the servo loop, or let it go on."""
        self.fail("stalled", on=on)

    def uncalibrate(self, styles: int, status: int) -> None:
        """Offer these styles of calibration (bits) and report this calibration state."""
        self._stub.mmt_stub_calibration(styles, status)

    # --- the world

    def limits(self, force_n: float, stiffness_n_mm: float) -> None:
        """Set the largest force and stiffness that the device reports."""
        self._stub.mmt_stub_limits(force_n, stiffness_n_mm)

    def hold(self, position_mm: Vector, stiffness_n_mm: float) -> None:
        """Hold the first tip by a spring to a place."""
        self._stub.mmt_stub_hand(0, 1, _Three(*position_mm), stiffness_n_mm)

    def release(self) -> None:
        """Let the first tip go."""
        self._stub.mmt_stub_hand(0, 0, _Three(), 0.0)

    def wall(self, height_mm: float, stiffness_n_mm: float) -> None:
        """Put a wall below this height (y) of the first tip; a stiffness of 0 takes it away."""
        self._stub.mmt_stub_wall(0, int(stiffness_n_mm > 0.0), height_mm, stiffness_n_mm)

    def place(self, position_mm: Vector, *, device: int = 0) -> None:
        """Put a tip somewhere, at rest."""
        self._stub.mmt_stub_place(device, _Three(*position_mm))

    def turn(self, columns: Sequence[float]) -> None:
        """Turn the first stylus: nine numbers of a rotation matrix, column by column."""
        self._stub.mmt_stub_turn(0, _Nine(*columns))

    def tip_state(self, *, device: int = 0) -> EmulatedTipState:
        """Return the true state of a tip, and the force of its motors."""
        v = _Nine()
        self._stub.mmt_stub_look(device, v)
        return EmulatedTipState((v[0], v[1], v[2]), (v[3], v[4], v[5]), (v[6], v[7], v[8]))

    @property
    def ticks(self) -> int:
        """How often the servo loop has run, in this process."""
        return int(self._stub.mmt_stub_ticks())

    @property
    def own_ns(self) -> int:
        """Processor time of the servo loop so far, in this process, without its callbacks."""
        return int(self._stub.mmt_stub_own_ns())
