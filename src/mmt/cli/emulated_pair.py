"""Scenes of a leader and a follower, with every device emulated at its wire, for the demo."""

from contextlib import suppress
from pathlib import Path
from typing import Any, Final, NamedTuple

import tomli_w

from mmt.core.errors import InputError
from mmt.core.existing_files import write_file
from mmt.scene import Scene
from mmt.scene.files import find_scene, load_scene

_EMULATED: Final = {
    "openhaptics": ("virtual-phantom", {"library", "device"}),
    "ati-net-ft": ("virtual-net-ft", {"host", "rdt_port", "http_port"}),
    "adxl335-serial": ("virtual-adxl335", {"port", "baud_rate", "serial"}),
    "haptuator-sound": ("virtual-haptuator-sound", {"device"}),
}
"""By driver: the emulated driver, and options with the device's address, to be removed."""
_NETWORK: Final = {"profile": "wan"}


class SceneFiles(NamedTuple):
    """The scene files of leader and follower."""

    leader: Path
    follower: Path


def pair_named(name: Path) -> SceneFiles | None:
    """Return the scenes ``NAME-leader`` and ``NAME-follower``, or None if they do not exist."""
    for suffix in ("", ".toml"):
        with suppress(InputError):
            return SceneFiles(
                *(find_scene(Path(f"{name}-{side}{suffix}")) for side in SceneFiles._fields)
            )
    return None


def hand_log(directory: Path) -> Path:
    """Return the file for the emulated hand's motion."""
    return directory / "hand.npz"


def coil_log(directory: Path) -> Path:
    """Return the file for the emulated coil's input."""
    return directory / "coil.npz"


def write_emulated(pair: SceneFiles, directory: Path) -> SceneFiles:
    """Write both scenes with emulated devices and network; return the files.

    A scene without ``[network]`` gets the profile ``wan``; ``MMT_NETWORK__PROFILE`` overrides it.

    Raises
    ------
    InputError
        A scene is not valid, has a driver without an emulated device, or cannot be written.
    """
    written = []
    for file in pair:
        tables = _emulated(load_scene(file), directory.resolve())
        target = directory / file.name
        if target.exists() and target.samefile(file):
            raise InputError(f"--output {directory}: the scenes are there; name another folder")
        write_file(target, tomli_w.dumps(tables))
        written.append(target)
    return SceneFiles(*written)


def _emulated(scene: Scene, directory: Path) -> dict[str, Any]:
    tables = scene.dump()
    for key in ("token_file", "certificate", "key", "authority", "host"):
        tables.get("link", {}).pop(key, None)
    tables.setdefault("network", _NETWORK)
    tables.setdefault("recording", {}).update(file=str(directory / "session.mcap"))
    if "handle" in tables:
        tables["handle"] = {**_device(tables["handle"]), "log": str(hand_log(directory))}
    if tables.get("actuator", {}).get("driver"):
        tables["actuator"] = {**_device(tables["actuator"]), "log": str(coil_log(directory))}
    devices = tables.get("devices", {})
    for role in ("robot", "force_sensor", "accelerometer"):
        if role in devices:
            devices[role] = _device(devices[role])
    return tables


def _device(table: dict[str, Any]) -> dict[str, Any]:
    driver = table["driver"]
    if driver not in _EMULATED:
        raise InputError(
            f"the driver {driver} has no emulated device here; {', '.join(_EMULATED)} have one"
        )
    emulated, places = _EMULATED[driver]
    left = {key: value for key, value in table.items() if key not in places}
    return {**left, "driver": emulated}
