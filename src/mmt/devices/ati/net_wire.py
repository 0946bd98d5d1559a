"""Bytes of the Net F/T: the page of settings, and the records that it streams."""

import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from mmt.core.bounds import finite_number
from mmt.core.errors import MmtError
from mmt.core.requests import AnswerError, open_answer
from mmt.devices.ati.calibration import Calibration, wrench_units
from mmt.devices.wrench import diagonal, six_of

PORT: Final = 49152

STOP: Final = 0x0000
START: Final = 0x0002
"""Send records as they are measured, each in a packet of its own."""
RESET_LATCH: Final = 0x0041

RECORD: Final = struct.Struct(">3I6i")
"""Number of the record in this stream, from 1, number of the measurement by the box's own rate,
status, then Fx Fy Fz Tx Ty Tz in counts."""

ERROR: Final = 0x80000000
RDT_ERROR: Final = 0x00100000
SATURATED: Final = 0x00020000
MONITOR_LATCHED: Final = 0x00010000

_REQUEST: Final = struct.Struct(">HHI")
_MARK: Final = 0x1234
_HARMLESS: Final = ERROR | SATURATED | MONITOR_LATCHED
_NAMES: Final = {
    RDT_ERROR: "an error of its data transfer",
    SATURATED: "saturation of the transducer",
    MONITOR_LATCHED: "a latched monitor condition",
}


def request(command: int, count: int = 0) -> bytes:
    """Return a request; a count of 0 means without end."""
    return _REQUEST.pack(_MARK, command, count)


def parse_request(packet: bytes) -> tuple[int, int] | None:
    """Return command and count of a request, or None if the packet is no request."""
    if len(packet) != _REQUEST.size:
        return None
    mark, command, count = _REQUEST.unpack(packet)
    return (command, count) if mark == _MARK else None


def is_broken(status: int) -> bool:
    """Return whether a record with this status must be discarded."""
    return status & ~_HARMLESS != 0


def explain_status(status: int) -> str:
    """Return the meaning of a status word as text."""
    causes = [name for bit, name in _NAMES.items() if status & bit]
    if status & ~(ERROR | RDT_ERROR | SATURATED | MONITOR_LATCHED):
        causes.append("see the System Information page of the box")
    return f"status 0x{status:08X}" + (f" ({'; '.join(causes)})" if causes else "")


TIMEOUT_S: Final = 2.0
_LARGEST_PAGE: Final = 65_536

FIRST_ORDER: Final = range(1, 9)
"""Filters whose cut-offs are those of ``y += (x - y) / 2**k`` at 7 kHz within 15 %."""
_BOX_RATE_HZ: Final = 7000.0


@dataclass(frozen=True, slots=True)
class NetSettings:
    """Settings that the box reports."""

    calibration: Calibration
    """Its matrix is for counts."""
    rate_hz: float
    """Records a second."""
    filter: int
    """Number of the low-pass filter."""
    bias: str
    """The gauges' software bias, as the box writes it."""


def filter_delay_ns(number: int) -> int:
    """Return a filter's group delay at low frequencies (ns), or 0 if it is not known.

    The maker states no delay. The cut-offs of filters k = 1 to 8 halve from one to the next,
    like those of the recursion ``y += (x - y) / 2**k`` at the box's 7 kHz, whose delay is
    ``2**k - 1`` measurements. The filters above 1 kHz delay by a fraction of filter 1's delay.
    """
    if number not in FIRST_ORDER:
        return 0
    return round(((1 << number) - 1) * 1e9 / _BOX_RATE_HZ)


def parse_page(text: str) -> dict[str, str]:
    """Return the values of a flat XML page by their names."""
    return {name: value.strip() for name, value in re.findall(r"<(\w+)>([^<]*)</\1>", text)}


def parse_settings(
    page: Mapping[str, str], calibration_page: Mapping[str, str], device: str
) -> NetSettings:
    """Read the settings out of ``netftapi2.xml`` and ``netftcalapi.xml``.

    Raises
    ------
    MmtError
        A value is missing or not usable, or RDT is switched off.
    """
    if page.get("comrdte", "1").lower() not in {"1", "enabled", "true", "on"}:
        raise MmtError(
            f"{device}: RDT is switched off in the box: enable it on its Communications page"
        )
    force_unit = _value(page, "scfgfu", device)
    units = wrench_units(force_unit, _value(page, "scfgtu", device), device)
    ranges = [_number(part, "cfgmr", device) for part in _value(page, "cfgmr", device).split(";")]
    if len(ranges) != 6 or min(ranges) <= 0:
        raise MmtError(f"{device}: its ranges 'cfgmr' are {page['cfgmr']!r}, six are expected")
    return NetSettings(
        calibration=Calibration(
            serial=calibration_page.get("calsn", ""),
            part=calibration_page.get("calpn", ""),
            force_unit=force_unit,
            matrix=diagonal(
                units[0] / _positive(page, "cfgcpf", device),
                units[3] / _positive(page, "cfgcpt", device),
            ),
            limits=six_of([unit * value for unit, value in zip(units, ranges, strict=True)]),
        ),
        rate_hz=_positive(page, "comrdtrate", device),
        filter=int(_number(page.get("setuserfilter", "0"), "setuserfilter", device)),
        bias=page.get("setbias", ""),
    )


class NetPages:
    """The box's web server.

    Parameters
    ----------
    host, port
        Address of the web server.
    device
        Name of the box in messages.
    """

    def __init__(self, host: str, port: int, device: str) -> None:
        self._host = host
        self._port = port
        self._device = device

    def settings(self) -> NetSettings:
        """Read the settings of the active configuration.

        Raises
        ------
        MmtError
            The box does not answer, or not as a Net F/T does.
        """
        page = parse_page(self._get("/netftapi2.xml"))
        calibration: dict[str, str] = {}
        if page.get("cfgcalsel", "").isdigit():
            calibration = parse_page(self._get(f"/netftcalapi.xml?index={page['cfgcalsel']}"))
        return parse_settings(page, calibration, self._device)

    def set_rate(self, rate_hz: int) -> None:
        """Set the rate of records (Hz); the box may round up."""
        self._get(f"/comm.cgi?comrdtrate={rate_hz}")

    def set_filter(self, number: int) -> None:
        """Choose the low-pass filter."""
        self._get(f"/setting.cgi?setuserfilter={number}")

    def set_bias(self, bias: str) -> None:
        """Write the gauges' software bias, in the form of `NetSettings.bias`."""
        query = "&".join(f"setbias{i}={part.strip()}" for i, part in enumerate(bias.split(";")))
        self._get(f"/setting.cgi?{query}")

    def _get(self, path: str) -> str:
        server = f"http://{self._host}:{self._port}"
        try:
            with open_answer(server, path, timeout_s=TIMEOUT_S) as answer:
                content = answer.content(_LARGEST_PAGE)
        except AnswerError as error:
            raise MmtError(
                f"{self._device}: its web page {path} answers {error.status} {error.reply}; "
                "check that 'host' is a Net F/T box"
            ) from error
        except MmtError as error:
            raise MmtError(
                f"{self._device}: its web page {server}{path} does not answer ({error}); "
                "check power, cable, 'host', and that this machine has an "
                "address in the box's network (192.168.1.x as it is shipped)"
            ) from error
        return content.decode("latin-1")


def _value(page: Mapping[str, str], name: str, device: str) -> str:
    if not page.get(name):
        raise MmtError(
            f"{device}: its page netftapi2.xml has no {name!r}; check that 'host' is a Net F/T box"
        )
    return page[name]


def _number(text: str, name: str, device: str) -> float:
    try:
        return finite_number(text)
    except ValueError:
        raise MmtError(f"{device}: {name!r} of its page is {text!r}, not a finite number") from None


def _positive(page: Mapping[str, str], name: str, device: str) -> float:
    number = _number(_value(page, name, device), name, device)
    if number <= 0:
        raise MmtError(f"{device}: {name!r} of its page is {number}, not above zero")
    return number
