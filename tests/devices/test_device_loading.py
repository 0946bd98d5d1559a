"""Drivers by name: the table, other packages' entry points, options, and what is said."""

import pytest
from plugin_samples import install_package
from pydantic import BaseModel, ConfigDict, Field

from mmt.core.errors import DeviceLost, InputError, MmtError, located
from mmt.core.plugins import is_own
from mmt.devices import drivers
from mmt.devices.drivers import load_device, read_options
from mmt.scene import Scene
from mmt.scene.files import environment_overrides, scene_from_tables

MODULE = """
from pydantic import BaseModel, ConfigDict

class Options(BaseModel):
    model_config = ConfigDict(extra="forbid")
    host: str
    rate_hz: int = 1000

class Sensor:
    def __init__(self, **options):
        self.options = Options(**options)

class Plain:
    def __init__(self, port="/dev/null"):
        self.port = port
"""


@pytest.fixture
def module(tmp_path, monkeypatch):
    (tmp_path / "optional_drivers.py").write_text(MODULE)
    monkeypatch.syspath_prepend(str(tmp_path))
    return "optional_drivers"


@pytest.fixture
def names(module, tmp_path, monkeypatch):
    """A driver whose role is named, and one that tells it itself."""
    names = {"inside.force_sensor": f"{module}:Sensor", "outside": f"{module}:Plain"}
    install_package(tmp_path, monkeypatch, "lab-devices", {drivers.GROUP: names})


def test_a_driver_of_the_table_gets_its_options(names):
    device = load_device("inside", {"host": "10.0.0.1", "rate_hz": 2000})
    assert (device.options.host, device.options.rate_hz) == ("10.0.0.1", 2000)


def test_a_driver_of_another_package_is_found_by_its_entry_point(names):
    assert load_device("outside", {"port": "/dev/ttyACM0"}).port == "/dev/ttyACM0"


def test_an_unknown_driver_is_answered_with_those_there_are(names):
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


def test_a_name_of_mmt_cannot_be_taken(module, tmp_path, monkeypatch):
    names = {"ati-net-ft.force_sensor": f"{module}:Plain"}
    install_package(tmp_path, monkeypatch, "lab-devices", {drivers.GROUP: names})
    assert drivers.locate("ati-net-ft") == "mmt.devices.ati.net_ft:net_ft"


def test_what_is_no_role_is_part_of_the_name(module, tmp_path, monkeypatch):
    install_package(
        tmp_path, monkeypatch, "lab-devices", {drivers.GROUP: {"a.b": f"{module}:Plain"}}
    )
    assert drivers.drivers()["a.b"][""].value == f"{module}:Plain"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"host": "a", "rate": 1}, "rate is not a key"),
        ({"host": "a", "rate_hz": "fast"}, "rate_hz is 'fast'"),
        ({}, "host"),
    ],
)
def test_an_option_that_a_driver_does_not_take_is_named(names, options, words):
    with pytest.raises(InputError, match=rf"device 'inside': .*{words}"):
        load_device("inside", options)


def test_an_option_that_a_plain_factory_does_not_take_is_bad_input(names):
    with pytest.raises(
        InputError, match=r"device 'outside': .*'speed'; its options are port='/dev/null'"
    ):
        load_device("outside", {"speed": 1})


def test_options_that_are_read_by_a_model_say_what_is_allowed():
    class Options(BaseModel):
        model_config = ConfigDict(extra="forbid")
        baud: int = Field(115_200, gt=0)

    assert read_options(Options, "box", {"baud": 9600}).baud == 9600
    with pytest.raises(InputError, match="device 'box': bauds is not a key; allowed are baud"):
        read_options(Options, "box", {"bauds": 9600})


def test_a_scene_names_a_driver_with_or_without_options():
    sensor = {"driver": "ati-net-ft", "host": "192.168.1.1", "filter": 4}
    scene = scene_from_tables(
        {
            "link": {},
            "devices": {"robot": "lab.arms:Arm", "force_sensor": sensor},
            "recording": {"channels": "needed"},
        }
    )
    assert scene.devices.robot.driver == "lab.arms:Arm"
    assert scene.devices.robot.options == {}
    assert scene.devices.force_sensor.options == {"host": "192.168.1.1", "filter": 4}
    assert Scene.model_validate(scene.dump()) == scene


def test_the_environment_names_a_driver_too():
    tables = {"link": {}, "devices": {"robot": "lab:Arm"}, "recording": {}}
    overrides = environment_overrides({"MMT_DEVICES__ROBOT": "lab:Other"})
    scene = scene_from_tables(tables, overrides)
    assert scene.devices.robot.driver == "lab:Other"


@pytest.mark.parametrize("driver", ["", "a:b:c", "lab:", {"host": "a"}, 5])
def test_what_is_no_driver_is_refused(driver):
    tables = {"link": {}, "devices": {"robot": driver}, "recording": {}}
    with pytest.raises(InputError, match=r"devices\.robot"):
        scene_from_tables(tables)


def test_a_lost_device_is_an_error_that_speaks():
    assert issubclass(DeviceLost, MmtError)
    assert DeviceLost("the box is silent").exit_code == 1


@pytest.mark.parametrize(("package", "told"), [("mmtools.arm", True), ("mmt_devices.arm", False)])
def test_the_line_of_another_packages_code_is_told(package, *, told):
    code = {"__name__": package}
    exec(compile("def move():\n    raise ValueError('stuck')", "arm.py", "exec"), code)
    with pytest.raises(ValueError, match="stuck") as caught:
        code["move"]()
    below = caught.value.__traceback__
    error = caught.value.with_traceback(below.tb_next)  # as called from the product's own code
    assert ("(arm.py, line 2)" in located(error)) == told
