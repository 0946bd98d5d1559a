"""`mmt device equalise`: from a recorded sweep to a stored level and equaliser."""

from pathlib import Path

import numpy as np

from mmt.arrays import FloatArray
from mmt.cli.common import output, write_json
from mmt.devices.haptuator.equalising import fit_equaliser
from mmt.devices.haptuator.level import store_level
from mmt.errors import InputError

_NAMES = ("drive_v", "acceleration_m_s2")


def equalise(
    recording: Path,
    serial: str,
    band_hz: tuple[float, float],
    largest_gain_db: float,
    json_file: Path | None,
) -> None:
    """Fit, show and store.

    Raises
    ------
    InputError
        The recording cannot be read or used.
    MmtError
        The calibration cannot be written.
    """
    volts, acceleration = _read(recording)
    low_hz, high_hz = band_hz
    fitted = fit_equaliser(
        volts, acceleration, low_hz=low_hz, high_hz=high_hz, largest_gain_db=largest_gain_db
    )
    path = store_level(fitted, serial)
    output.print(
        f"Haptuator {serial}: {fitted.volts_per_m_s2:.4g} V for 1 m/s2; uneven by "
        f"{fitted.unevenness_db:.1f} dB from {low_hz:g} to {high_hz:g} Hz, evened out to "
        f"{fitted.remaining_db:.1f} dB; coherence {fitted.coherence:.3f}",
        highlight=False,
    )
    output.print(f"stored in {path}", highlight=False, soft_wrap=True)
    write_json(json_file, {**fitted._asdict(), "serial": serial, "file": str(path)})


def _read(recording: Path) -> tuple[FloatArray, FloatArray]:
    try:
        with np.load(recording, allow_pickle=False) as arrays:
            volts, acceleration = (np.asarray(arrays[name], dtype=np.float64) for name in _NAMES)
    except KeyError as error:
        raise InputError(
            f"{recording}: {error.args[0]}; it needs {' and '.join(_NAMES)}"
        ) from error
    except Exception as error:  # an archive that is none fails in many ways
        raise InputError(
            f"{recording} cannot be read ({error}): it must be a .npz file with the arrays "
            f"{' and '.join(_NAMES)}, at 1 kHz"
        ) from error
    return volts, acceleration
