"""Drivers by name: the table, other packages' entry points, options, and what is said."""

import math

import pytest
from plugin_samples import install_package
from pydantic import BaseModel, ConfigDict

from mmt.core.errors import InputError, located
from mmt.core.plugins import is_own
from mmt.devices import drivers
from mmt.devices.axes import Axes, AxesOptions, SensorAxesOptions
from mmt.devices.drivers import load_device
from mmt.devices.openhaptics.options import HdOptions
from mmt.scene import Scene
from mmt.scene.files import environment_overrides, scene_from_tables


class Options(BaseModel):
    model_config = ConfigDict(extra="forbid")
    host: str
    rate_hz: int = 1000


class Sensor:
    def __init__(self, **options):
        self.options = Options(**options)


class Typed:
    OPTIONS = Options

    def __init__(self, options):
        self.options = options


class Plain:
    OPTIONS = ("no", "model")

    def __init__(self, port="/dev/null"):
        self.port = port


@pytest.fixture
def names(tmp_path, monkeypatch):
    """A driver whose role is named, and one that tells it itself: what is no role is its name."""
    names = {
        "inside.force_sensor": f"{__name__}:Sensor",
        "typed.force_sensor": f"{__name__}:Typed",
        "outside.one": f"{__name__}:Plain",
    }
    install_package(tmp_path, monkeypatch, "lab-devices", {drivers.GROUP: names})


def test_drivers_of_other_packages_are_found_by_their_entry_points(names):
    for name in ("inside", "typed"):
        device = load_device(name, {"host": "10.0.0.1", "rate_hz": 2000})
        assert device.options == Options(host="10.0.0.1", rate_hz=2000)
    assert load_device("outside.one", {"port": "/dev/ttyACM0"}).port == "/dev/ttyACM0"
    with pytest.raises(InputError, match=r"'insid' is not known; allowed are .*inside.* outside"):
        load_device("insid")


def test_every_driver_of_mmt_has_a_role_and_a_factory():
    own = {
        name: entries
        for name, entries in drivers.drivers().items()
        if all(map(is_own, entries.values()))
    }
    assert {"openhaptics", "ati-net-ft", "adxl335-serial", "haptuator-sound"} <= set(own)
    for driver in own:
        assert drivers.entry_points_by_role(driver)
        for role in drivers.entry_points_by_role(driver):
            assert callable(drivers.load_factory(driver, role))


def test_a_name_of_mmt_cannot_be_taken(tmp_path, monkeypatch):
    names = {"ati-net-ft.force_sensor": f"{__name__}:Plain"}
    install_package(tmp_path, monkeypatch, "lab-devices", {drivers.GROUP: names})
    assert drivers.locate("ati-net-ft") == "mmt.devices.ati.net_ft:NetFt"


@pytest.mark.parametrize(
    ("driver", "options", "words"),
    [
        ("inside", {"host": "a", "rate": 1}, "rate is not a key"),
        ("typed", {"host": "a", "rate": 1}, "rate is not a key; allowed are host, rate_hz"),
        ("typed", {"host": "a", "rate_hz": "fast"}, "rate_hz is 'fast'"),
        ("inside", {"host": "a", "rate_hz": "fast"}, "rate_hz is 'fast'"),
        ("inside", {}, "host"),
        ("outside.one", {"speed": 1}, ".*'speed'; its options are port='/dev/null'"),
    ],
)
def test_an_option_that_a_driver_does_not_take_is_named(names, driver, options, words):
    with pytest.raises(InputError, match=rf"device '{driver}': .*{words}"):
        load_device(driver, options)


def test_a_scene_names_a_driver_with_or_without_options_and_the_environment_another():
    sensor = {"driver": "ati-net-ft", "host": "192.168.1.1", "filter": 4}
    devices = {"robot": "lab.arms:Arm", "force_sensor": sensor}
    tables = {"link": {}, "devices": devices, "recording": {"channels": "needed"}}
    scene = scene_from_tables(tables)
    assert scene.devices.robot.driver == "lab.arms:Arm"
    assert scene.devices.robot.options == {}
    assert scene.devices.force_sensor.options == {"host": "192.168.1.1", "filter": 4}
    assert Scene.model_validate(scene.dump()) == scene
    overrides = environment_overrides({"MMT_DEVICES__ROBOT": "lab:Other"})
    assert scene_from_tables(tables, overrides).devices.robot.driver == "lab:Other"


@pytest.mark.parametrize("driver", ["", "a:b:c", "lab:", {"host": "a"}, 5])
def test_what_is_no_driver_is_refused(driver):
    tables = {"link": {}, "devices": {"robot": driver}, "recording": {}}
    with pytest.raises(InputError, match=r"devices\.robot"):
        scene_from_tables(tables)


@pytest.mark.parametrize(("package", "told"), [("mmtools.arm", True), ("mmt_devices.arm", False)])
def test_the_line_of_another_packages_code_is_told(package, *, told):
    code = {"__name__": package}
    exec(compile("def move():\n    raise ValueError('stuck')", "arm.py", "exec"), code)
    with pytest.raises(ValueError, match="stuck") as caught:
        code["move"]()
    below = caught.value.__traceback__
    error = caught.value.with_traceback(below.tb_next)  # as called from the product's own code
    assert ("(arm.py, line 2)" in located(error)) == told


VOLTS = {"volts_per_m_s2": 0.1, "full_scale_v": 6}
REFUSED = [
    ("adxl335-board", {"board": "labjack-u6", "port": "a"}, "port is not a key; allowed .*board"),
    *((name, {"port": ""}, "port is ''") for name in ("adxl335-serial", "bota-serial")),
    ("adxl335-serial", {"port": "a", "axes": ["x", "x", "z"]}, "must name each of x, y, z once"),
    ("adxl335-serial", {"port": "a", "supply_v": 5.0}, "supply_v is 5.0"),
    ("ati-digital-ft", {"port": "x", "baud": 9600}, "baud"),
    ("ati-gauges", {}, "calibration_file"),
    ("ati-net-ft", {"filter": 13}, "filter"),
    ("ati-net-ft", {"range_n": (1, 2)}, "range_n"),
    ("ati-net-ft", {"mounted": "x"}, "mounted"),
    ("bota-serial", {"port": "x", "sinc_length": 50}, "sinc_length"),
    ("bota-serial", {"port": "x", "baud": 230_400}, "230400 baud carry 623: raise 'sinc_length'"),
    ("franka", {"host": "arm", "stiffness_n_mm": 5.0}, "stiffness_n_mm is 5"),
    ("franka", {"host": "arm", "force_limit_n": 30.0}, "lower the first, or raise the second"),
    ("franka", {"host": "arm", "speed": 1.0}, "not a key; allowed are axes, host, realtime"),
    ("haptuator-sound", {"volts_per_m_s2": 0.1}, "full_scale_v"),
    ("haptuator-sound", {"full_scale_v": 6}, "serial"),
    ("haptuator-sound", {**VOLTS, "low_hz": 300, "high_hz": 200}, "above low_hz"),
    ("haptuator-sound", {**VOLTS, "limit_v": -1}, "limit_v"),
    ("haptuator-sound", {**VOLTS, "volume": 3}, "volume"),
    ("iio-accelerometer", {"stamps": "own"}, "stamps"),
    ("labjack-u6", {"inputs": []}, "inputs is .*at least 1"),
    ("labjack-u6", {"inputs": [*range(14), 0]}, "inputs is .*at most 14"),
    ("labjack-u6", {"inputs": [14]}, "input 14"),
    ("labjack-u6", {"gain": 5}, "gain is 5"),
    ("labjack-u6", {"inputs": [1], "differential": True}, "even half"),
    ("labjack-u6", {"rate_hz": 50.0}, "rate_hz is 50.0"),
    ("labjack-u6", {"rate_hz": math.nan}, "rate_hz is nan"),
    ("labjack-u6", {"inputs": range(14), "rate_hz": 4e3}, "50000 samples .*, which is 3571 Hz"),
    ("openhaptics", {"stiffness_n_mm": 2.0, "damping_n_s_m": 1.0}, "oscillates at 1 kHz below 3"),
    ("openhaptics", {"axes": "x,y,y"}, "name x, y and z once each"),
    ("openhaptics", {"axes": "x,y,-z"}, "mirrors"),
    ("openhaptics", {"axes": ["x", 5, "z"]}, "axes are 'x,5,z': name x, y and z once each"),
    ("openhaptics", {"force_limit_n": math.inf}, "force_limit_n"),
    ("ur", {"host": "a", "frequency_hz": 1000}, "frequency_hz"),
    ("ur", {"host": "a", "least_mm": [0, 0, 5], "most_mm": [1, 1, 5]}, "along z"),
    ("virtual-robot", {"acceleration_rate_hz": 1500}, "acceleration_rate_hz"),
]


@pytest.mark.parametrize(("driver", "options", "words"), REFUSED)
def test_a_refused_option_is_named(driver, options, words):
    with pytest.raises(InputError, match=f"device '{driver}': .*{words}"):
        load_device(driver, options)


@pytest.mark.parametrize("axes", ["x, -z,y", ["x", "-z", "y"]])
def test_axes_are_named_in_one_way_or_the_other_by_every_driver(axes):
    assert SensorAxesOptions(axes=axes).axes == ("x", "-z", "y")
    for options in AxesOptions, HdOptions:
        turned = Axes(options(axes=axes).axes).to_scene((1.0, 2.0, 3.0))
        assert turned == (1.0, -3.0, 2.0)


@pytest.mark.parametrize(
    ("driver", "role", "options", "words"),
    [
        ("adxl335-board", None, {"board": "labjack-u6"}, "set to 6 inputs, the sensor needs three"),
        ("openhaptics", "handle", {"force_limit_n": [1.0, 0.0, 3.0]}, "force_limit_n"),
        ("ur", "force_sensor", {"host": "a", "origin_mm": [0, 0, 0]}, "origin_mm"),
        ("inverse3", "handle", {"address": "localhost:10001"}, "address"),
        ("inverse3", "handle", {"lead_limit_mm": 5.0}, "lead_limit_mm is not a key; allowed are a"),
        ("inverse3", "robot", {"origin_mm": [0.0, math.nan, 0.0]}, "origin_mm"),
        ("inverse3", "robot", {"commands": "2.0"}, "commands"),
        ("virtual-inverse3", "robot", {"axes": "x,y,-z"}, "mirrors"),
    ],
)
def test_a_refused_option_of_a_role_is_named(driver, role, options, words):
    with pytest.raises(InputError, match=words):
        load_device(driver, options, role=role)
