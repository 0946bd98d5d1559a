"""Constants of OpenHaptics HD, from the vendor's ``hdDefines.h``."""

from typing import Final, NamedTuple

DONE: Final = 0
CONTINUE: Final = 1
INVALID_HANDLE: Final = 0xFFFFFFFF
DEFAULT_PRIORITY: Final = 0xFFFF // 2

CURRENT_POSITION: Final = 0x2050
CURRENT_VELOCITY: Final = 0x2051
CURRENT_TRANSFORM: Final = 0x2052
MODEL: Final = 0x2501
SERIAL_NUMBER: Final = 0x2504
CALIBRATION_STYLE: Final = 0x2555
NOMINAL_MAX_STIFFNESS: Final = 0x2602
NOMINAL_MAX_FORCE: Final = 0x2603
CURRENT_FORCE: Final = 0x2700

FORCE_OUTPUT: Final = 0x4000
MAX_FORCE_CLAMPING: Final = 0x4001

CALIBRATION_OK: Final = 0x5000
CALIBRATION_NEEDS_UPDATE: Final = 0x5001
ENCODER_RESET: Final = 1
AUTO: Final = 2
INKWELL: Final = 4

WARM_MOTORS: Final = 0x0200
FORCE_ERROR: Final = 0x0204
DEVICE_FAULT: Final = 0x0300
COMM_ERROR: Final = 0x0302


class HdError(NamedTuple):
    """One entry of HD's stack of errors."""

    code: int
    internal: int
    """The device's own number for it."""


_REPORT: Final = "this is a mistake in the driver: please report it with this sentence"

SENTENCES: Final[dict[int, tuple[str, str, str]]] = {
    0x0100: ("INVALID_ENUM", "the library does not know what it was asked for",
             "take the driver package that belongs to this device"),
    0x0101: ("INVALID_VALUE", "a value was not accepted", _REPORT),
    0x0102: ("INVALID_OPERATION", "a call came where it is not allowed", _REPORT),
    0x0103: ("INVALID_INPUT_TYPE", "a kind of value was not accepted", _REPORT),
    0x0104: ("BAD_HANDLE", "the device is not open any more", "connect again"),
    0x0200: ("WARM_MOTORS", "the motors are too warm and give no force",
             "let go, let them cool for some minutes, and lower 'force_limit_n'"),
    0x0201: ("EXCEEDED_MAX_FORCE", "more force was asked for than the device can give",
             "lower 'force_limit_n' or the gains"),
    0x0202: ("EXCEEDED_MAX_FORCE_IMPULSE", "the force changed too fast",
             "lower 'stiffness_n_mm' or 'force_limit_n'"),
    0x0203: ("EXCEEDED_MAX_VELOCITY", "the tip moved too fast, the force was switched off",
             "hold the tip, and lower the gains if it trembles"),
    0x0204: ("FORCE_ERROR", "the force could not be set", "look at the emergency stop and power"),
    0x0300: ("DEVICE_FAULT", "the device has a fault or is not there",
             "check its power, its cable and its name in the vendor's set-up, then connect again"),
    0x0301: ("DEVICE_ALREADY_INITIATED", "it is in use already",
             "close the other program, or give the other device's name with 'device'"),
    0x0302: ("COMM_ERROR", "it does not answer",
             "check cable, power and who may open the port, then connect again"),
    0x0303: ("COMM_CONFIG_ERROR", "its port is not set up",
             "run the vendor's set-up program and choose the port"),
    0x0304: ("TIMER_ERROR", "the servo loop's timer failed", "restart the program or the machine"),
    0x0400: ("ILLEGAL_BEGIN", "a frame began within a frame", _REPORT),
    0x0401: ("ILLEGAL_END", "a frame ended that had not begun", _REPORT),
    0x0402: ("FRAME_ERROR", "a frame took longer than the servo's tick",
             "take load off this machine"),
    0x0500: ("INVALID_PRIORITY", "a priority was not accepted", _REPORT),
    0x0501: ("SCHEDULER_FULL", "the servo loop takes no further part", "close other devices"),
    0x0600: ("INVALID_LICENSE", "the OpenHaptics licence is missing or has run out",
             "install a valid licence"),
}  # fmt: skip


def name_of(code: int) -> str:
    """Return the vendor's name of an error, without its prefix."""
    return SENTENCES[code][0] if code in SENTENCES else f"0x{code:04X}"


def explain(device: str, error: HdError) -> str:
    """Return what was seen and what to do, for the device of this name."""
    name, seen, to_do = SENTENCES.get(
        error.code, (name_of(error.code), "an error that is not known", "look it up in hdDefines.h")
    )
    return f"{device}: {seen} (HD_{name}, device's own code {error.internal}): {to_do}"


def only_force(code: int) -> bool:
    """Return whether an error concerns the force alone: the device still measures."""
    return WARM_MOTORS <= code <= FORCE_ERROR
