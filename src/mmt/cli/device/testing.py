"""``mmt device test``: observe the devices of a scene, or one driver's device."""

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

from mmt.cli.common import messages, output, write_json
from mmt.cli.options import value_of
from mmt.core.errors import InputError
from mmt.devices.device_check import DeviceCheck, Values, check_device
from mmt.devices.drivers import ROLE_NAMES, Role, load_device, role_for
from mmt.scene import Scene
from mmt.scene.files import example_scenes, load_scene


class NamedDevice(NamedTuple):
    """A device named by a scene or by the user."""

    role: Role | None
    driver: str
    options: dict[str, Any]
    samples_hz: int = 1000
    """Rate at which the scene uses the device's samples."""

    @property
    def title(self) -> str:
        """Role and driver, for messages."""
        return f"{ROLE_NAMES[self.role] if self.role else 'device'} ({self.driver})"


def observe_all(
    devices: list[NamedDevice], duration_s: float, *, calibrate: bool, json_file: Path | None
) -> bool:
    """Observe devices one after the other, show the results, return whether all are good."""
    seen = []
    for named in devices:
        device = load_device(named.driver, named.options, role=named.role)
        messages.print(f"{named.title}: {duration_s:g} s")
        one = check_device(
            named.role or "device",
            named.driver,
            device,
            duration_s=duration_s,
            calibrate=calibrate,
            samples_hz=named.samples_hz,
            show=_show,
        )
        seen.append(one)
        output.print(f"{named.title}: {_state(one)}")
        for name, text in _figures(one):
            output.print(f"  {name:<10} {text}")
        for problem in one.problems:
            output.print(f"  - {problem}")
    write_json(json_file, {"devices": [asdict(one) for one in seen]})
    return not any(one.problems for one in seen)


def devices_named(what: str, role: str | None, settings: list[str]) -> list[NamedDevice]:
    """Return the devices of a scene, given its name or file, or the device of a driver.

    Raises
    ------
    InputError
        There is no such scene or driver, or the scene has no such device.
    """
    options = options_from(settings)
    if not is_scene(what):
        return [NamedDevice(role_for(what, role), what, options)]
    if options:
        raise InputError("--set gives options to a driver: a scene has its own")
    found = list(of_scene(load_scene(Path(what))))
    if not found:
        raise InputError(f"scene {what} names no device: add [devices], [handle] or an actuator")
    if role is None:
        return found
    chosen = [named for named in found if named.role == role.replace("-", "_")]
    if not chosen:
        roles = ", ".join(str(named.role) for named in found)
        raise InputError(f"scene {what} has no {role}; it has {roles}")
    return chosen


def is_scene(what: str) -> bool:
    """Return whether a name is a scene's, not a driver's."""
    return what.endswith(".toml") or what in example_scenes()


def of_scene(scene: Scene) -> Iterator[NamedDevice]:
    """Yield the devices of a scene that have drivers."""
    roles: tuple[Role, ...] = ("robot", "force_sensor", "accelerometer")
    session = scene.session
    for role in roles if scene.devices is not None else ():
        device = getattr(scene.devices, role)
        if device is not None:
            rate_hz = session.acceleration_rate_hz if role == "accelerometer" else session.rate_hz
            yield NamedDevice(role, device.driver, device.options, rate_hz)
    if scene.handle is not None:
        yield NamedDevice("handle", scene.handle.driver, scene.handle.options)
    if scene.actuator is not None and scene.actuator.driver is not None:
        yield NamedDevice("actuator", scene.actuator.driver, scene.actuator.options)


def options_from(settings: list[str]) -> dict[str, Any]:
    """Parse settings KEY=VALUE, with values as in TOML; other values are taken as text."""
    options: dict[str, Any] = {}
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not equals or not key.strip():
            raise InputError(f"--set {setting}: write KEY=VALUE")
        options[key.strip()] = value_of(text)
    return options


def _state(seen: DeviceCheck) -> str:
    if not seen.problems:
        return "good"
    return f"{len(seen.problems)} problem{'s' if len(seen.problems) > 1 else ''}"


def _show(seen: DeviceCheck) -> None:
    rate = "" if seen.rate_hz is None else f", {seen.rate_hz:.0f} readings/s"
    if seen.newest is not None:
        values = _numbers(seen.newest, seen.unit)
    else:
        values = "playing silence" if seen.played else "no reading yet"
    messages.print(f"  {seen.duration_s:4.0f} s  {values}{rate}")


def _figures(seen: DeviceCheck) -> Iterator[tuple[str, str]]:
    """Yield name and text of each known figure."""
    if seen.mean is not None:
        yield "mean", _numbers(seen.mean, seen.unit)
        yield "deviation", _numbers(seen.deviation or (), seen.unit)
    if seen.rate_hz is not None:
        yield "rate", f"{seen.rate_hz:.0f} readings/s on a clock of its own"
    elif seen.readings:
        yield "rate", f"answered {seen.readings} times, whenever it was asked"
    if seen.spacing_p50_ms is not None and seen.spacing_p99_ms is not None:
        yield "stamps", f"{seen.spacing_p50_ms:.3f} ms apart, 99 % within {seen.spacing_p99_ms:.3f}"
    if seen.arrival_p99_ms is not None:
        yield "arrivals", f"99 % within {seen.arrival_p99_ms:.1f} ms of each other"
    if seen.latency_ms is not None:
        yield "latency", f"{seen.latency_ms:.2f} ms from the instant to its stamp, as it says"
    if seen.played:
        known = {name: value for name, value in seen.played.items() if value is not None}
        yield "played", ", ".join(_counted(name, value) for name, value in known.items())


def _counted(name: str, value: float) -> str:
    """Return a figure as text, with the unit from the end of its name."""
    for ending, unit in (("_m_s2", "m/s2"), ("_ppm", "ppm"), ("_ms", "ms")):
        if name.endswith(ending):
            return f"{name.removesuffix(ending).replace('_', ' ')} {value:.4g} {unit}"
    return f"{name.replace('_', ' ')} {value:.4g}"


def _numbers(values: Values, unit: str) -> str:
    return f"{'  '.join(f'{value + 0.0:.4g}' for value in values)} {unit}".rstrip()
