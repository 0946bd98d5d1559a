"""Find boards through NI's package ``nidaqmx``, and turn NI-DAQmx errors into sentences."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

import nidaqmx
from nidaqmx.error_codes import DAQmxErrors
from nidaqmx.errors import DaqError, DaqNotFoundError, DaqNotSupportedError, Error
from nidaqmx.system import System

from mmt.core.errors import InputError, MmtError
from mmt.devices.discovery import FoundPort


class Daqmx:
    """NI-DAQmx of this machine."""

    def devices(self) -> Any:
        """Return the devices that NI-DAQmx knows."""
        return System.local().devices

    def task(self) -> Any:
        """Return a new task, which the caller closes."""
        return nidaqmx.Task()


LOCAL: Final = Daqmx()


@contextmanager
def explained() -> Iterator[None]:
    """Turn an error of NI-DAQmx into an `MmtError` that says what to do.

    Raises
    ------
    MmtError
        NI-DAQmx is not installed, not available for this system, or reports an error.
    """
    try:
        yield
    except DaqNotFoundError as error:
        raise MmtError(
            "boards by NI need NI's driver NI-DAQmx, which is not installed; install it with: "
            "python -m nidaqmx installdriver"
        ) from error
    except DaqNotSupportedError as error:
        raise MmtError(
            "boards by NI need NI-DAQmx, which is for Linux and Windows alone"
        ) from error
    except Error as error:
        raise MmtError(f"the board by NI: {explain(error)}") from error


def explain(error: Error) -> str:
    """Return the message of an error on one line, with its NI-DAQmx number if it has one."""
    if not isinstance(error, DaqError):
        return " ".join(str(error).split())
    if error.error_code == DAQmxErrors.PAL_RESOURCE_RESERVED:
        return "another program has it: close that one"
    lines = [
        " ".join(paragraph.split())
        for paragraph in str(error).split("\n\n")
        if not paragraph.startswith(("Task Name", "Status Code"))
    ]
    return f"{' '.join(lines)} (NI-DAQmx {error.error_code})"


def boards(daqmx: Daqmx) -> list[Any]:
    """Return the devices that have analogue inputs.

    Raises
    ------
    MmtError
        NI-DAQmx cannot be used.
    """
    with explained():
        return [device for device in daqmx.devices() if input_names(device)]


def input_names(device: Any) -> list[str]:
    """Return the names of a board's analogue inputs, such as ``ai0``."""
    return [name.rpartition("/")[2] for name in device.ai_physical_chans.channel_names]


def find_board(daqmx: Daqmx, name: str | None) -> Any:
    """Return the board with this name, or the only board if `name` is None.

    Raises
    ------
    InputError
        There are several boards, and `name` is None.
    MmtError
        There is no such board.
    """
    found = boards(daqmx)
    there = ", ".join(f"{device.name} ({device.product_type})" for device in found) or "none"
    chosen = [device for device in found if name in {None, device.name}]
    if not chosen:
        which = "" if name is None else f" named {name}"
        raise MmtError(f"there is no board by NI{which}: plug it in; there is {there}")
    if len(chosen) > 1:
        raise InputError(
            f"there are {len(found)} boards by NI: say which one by the option 'device': {there}"
        )
    return chosen[0]


def find_ports(daqmx: Daqmx = LOCAL) -> list[FoundPort]:
    """Return the boards by NI."""
    return [
        FoundPort(device.name, device.product_type, f"{device.serial_num:X}", "")
        for device in boards(daqmx)
    ]
