"""The distribution: its version, and the extras by which optional packages are installed."""

import json
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any, Final
from urllib.parse import unquote, urlsplit

from mmt.core.errors import InputError

__version__ = "0.1.0"

DISTRIBUTION: Final = "mmt-haptics"

PACKAGES: Final[dict[str, tuple[str, str]]] = {
    "mcap": ("recording", "recorded sessions need mcap"),
    "google": ("recording", "recorded sessions need protobuf"),
    "zstandard": ("recording", "recorded sessions need zstandard"),
    "lz4": ("recording", "recorded sessions need lz4"),
    "numba": ("leader", "the numerics need numba"),
    "scipy": ("leader", "the numerics need scipy"),
    "matplotlib": ("report", "reports and figures need matplotlib"),
    "PIL": ("report", "reports and figures need pillow"),
    "serial": ("devices", "serial ports need pyserial"),
    "usb": ("devices", "devices at USB need pyusb"),
    "rtde_control": ("ur", "arms by Universal Robots need ur-rtde"),
    "rtde_receive": ("ur", "arms by Universal Robots need ur-rtde"),
    "sounddevice": ("sound", "the sound card needs sounddevice"),
    "franky": ("franka", "Franka arms need franky-control (for Linux on x86-64)"),
    "nidaqmx": ("ni", "boards by NI need nidaqmx"),
    "pyarrow": ("export", "Parquet needs pyarrow"),
    "h5py": ("export", "HDF5 needs h5py"),
    "openpyxl": ("import", "workbooks need openpyxl"),
    "nptdms": ("import", "TDMS files need npTDMS"),
    "pyxdf": ("import", "XDF files need pyxdf"),
    "rosbags": ("import", "ROS bags need rosbags"),
    "prometheus_client": ("metrics", "[metrics] needs prometheus-client"),
    "pylsl": ("lsl", "[lsl] needs pylsl"),
    "redis": ("hub", "`mmt hub` needs redis"),
    "segno": ("share", "QR codes need segno"),
    "distributed": ("dask", "--dask needs distributed"),
    "mpmath": ("bench", "the reference of the bench needs mpmath"),
}
"""By import name: the extra that has the package, and a phrase saying what needs it."""


def require(package: str) -> None:
    """Check that an optional package is installed; it is not imported.

    Parameters
    ----------
    package
        A key of `PACKAGES`.

    Raises
    ------
    InputError
        The package is not installed; the message has the command that installs it.
    """
    if find_spec(package) is None:
        raise _lacking(package)


@contextmanager
def optional_import() -> Iterator[None]:
    """Raise the error of `require` if the block cannot import an optional package."""
    try:
        yield
    except ImportError as error:
        package = (error.name or "").partition(".")[0]
        if package not in PACKAGES or find_spec(package) is not None:
            raise
        raise _lacking(package) from error


def _lacking(package: str) -> InputError:
    extra, needing = PACKAGES[package]
    return InputError(
        f"{needing}, which is not installed; install it with: {install_command(extra)}"
    )


def install_command(extra: str) -> str:
    """Return the command that installs an extra, from the source of this installation."""
    return shlex.join([sys.executable, "-m", "pip", "install", *_target(extra)])


def _target(extra: str) -> list[str]:
    """Return pip's arguments: the clone, the file or the URL of the installation (PEP 610)."""
    from importlib.metadata import PackageNotFoundError, distribution

    wanted = f"{DISTRIBUTION}[{extra}]"
    try:
        origin: dict[str, Any] = json.loads(
            distribution(DISTRIBUTION).read_text("direct_url.json") or "{}"
        )
    except PackageNotFoundError:
        origin = {}
    url = origin.get("url")
    if url is None:
        return [wanted]
    if origin.get("dir_info", {}).get("editable"):
        return ["-e", f"{unquote(urlsplit(url).path)}[{extra}]"]
    vcs = origin.get("vcs_info")
    if vcs is not None:
        url = f"{vcs['vcs']}+{url}@{vcs['commit_id']}"
    return [f"{wanted} @ {url}"]
