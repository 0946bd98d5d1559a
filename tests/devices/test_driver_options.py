"""Options that drivers refuse: what is missing, unknown, or cannot be, is named."""

import math

import pytest

from mmt.core.errors import InputError
from mmt.devices.drivers import load_device

REFUSED = [
    ("adxl335-board", {}, "board"),
    ("adxl335-board", {"board": "labjack-u6", "port": "a"}, "port is not a key; allowed .*board"),
    ("adxl335-serial", {}, "port"),
    *((name, {"port": ""}, "port is ''") for name in ("adxl335-serial", "bota-serial")),
    ("ati-digital-ft", {"port": ""}, "port is ''"),
    ("adxl335-serial", {"port": "a", "baud": 9600}, "baud is not a key; allowed are .*baud_rate"),
    ("adxl335-serial", {"port": "a", "axes": ["x", "x", "z"]}, "must name each of x, y, z once"),
    ("adxl335-serial", {"port": "a", "supply_v": 5.0}, "supply_v is 5.0"),
    ("ati-digital-ft", {}, "port"),
    ("ati-digital-ft", {"port": "x", "baud": 9600}, "baud"),
    ("ati-digital-ft", {"port": "x", "speed": 1}, "speed is not a key"),
    ("ati-gauges", {}, "calibration_file"),
    ("ati-gauges", {"calibration_file": "a.cal"}, "board"),
    ("ati-gauges", {"calibration_file": "a.cal", "board": 1}, "board"),
    ("ati-net-ft", {"filter": 13}, "filter"),
    ("ati-net-ft", {"rate_hz": 0}, "rate_hz"),
    ("ati-net-ft", {"range_n": (1, 2)}, "range_n"),
    ("ati-net-ft", {"speed": 1}, "speed is not a key"),
    ("ati-net-ft", {"mounted": "x"}, "mounted"),
    ("bota-serial", {}, "port"),
    ("bota-serial", {"port": "x", "baud": 1200}, "baud"),
    ("bota-serial", {"port": "x", "sinc_length": 50}, "sinc_length"),
    ("bota-serial", {"port": "x", "baud": 230_400}, "230400 baud carry 623: raise 'sinc_length'"),
    ("franka", {}, "host"),
    ("franka", {"host": "arm", "axes": "x,y,-z"}, "mirrors"),
    ("franka", {"host": "arm", "stiffness_n_mm": 5.0}, "stiffness_n_mm is 5"),
    ("franka", {"host": "arm", "force_limit_n": 30.0}, "lower the first, or raise the second"),
    ("franka", {"host": "arm", "speed": 1.0}, "not a key; allowed are axes, host, realtime"),
    ("iio-accelerometer", {"rate_hz": 0}, "rate_hz"),
    ("iio-accelerometer", {"axes": ["x", "x", "z"]}, "must name each of x, y, z once"),
    ("iio-accelerometer", {"stamps": "own"}, "stamps"),
    ("iio-accelerometer", {"port": "x"}, "port is not a key"),
    ("labjack-u6", {"inputs": []}, "inputs"),
    ("openhaptics", {"stiffness_n_mm": 2.0, "damping_n_s_m": 1.0}, "oscillates at 1 kHz below 3"),
    ("openhaptics", {"axes": "x,y,y"}, "name x, y and z once each"),
    ("openhaptics", {"axes": "x,y,-z"}, "mirrors"),
    ("openhaptics", {"stiffness": 1.0}, "stiffness is not a key; allowed are axes, library"),
    ("openhaptics", {"force_limit_n": math.inf}, "force_limit_n"),
    ("ur", {}, "host"),
    ("ur", {"host": "a", "lookahead_s": 0.01}, "lookahead_s"),
    ("ur", {"host": "a", "gain": 50}, "gain"),
    ("ur", {"host": "a", "frequency_hz": 1000}, "frequency_hz"),
    ("ur", {"host": "a", "speed_limit_mm_s": 0}, "speed_limit_mm_s"),
    ("ur", {"host": "a", "least_mm": [0, 0, 5], "most_mm": [1, 1, 5]}, "along z"),
    ("ur", {"host": "a", "stuck_ms": 5}, "stuck_ms"),
    ("virtual-adxl335", {"seed": "many"}, "seed"),
    ("virtual-net-ft", {"seed": "many"}, "seed"),
    ("virtual-ni-daqmx", {"foo": 1}, "foo is not a key"),
    ("virtual-ni-daqmx", {"seed": "x"}, "seed"),
    ("virtual-robot", {"acceleration_rate_hz": 500}, "acceleration_rate_hz"),
    ("virtual-robot", {"acceleration_rate_hz": 1500}, "acceleration_rate_hz"),
    ("virtual-robot", {"acceleration_rate_hz": 11_000}, "acceleration_rate_hz"),
    ("virtual-robot", {"seed": "many"}, "seed"),
]


@pytest.mark.parametrize(("driver", "options", "words"), REFUSED)
def test_a_refused_option_is_named(driver, options, words):
    with pytest.raises(InputError, match=f"device '{driver}': .*{words}"):
        load_device(driver, options)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"inputs": [0, 14]}, "input 14"),
        ({"gain": 5}, "gain is 5"),
        ({"inputs": [1], "differential": True}, "even half"),
        ({"rate_hz": 10.0}, "rate_hz is 10.0"),
        ({}, "set to 6 inputs, the sensor needs three"),
    ],
)
def test_a_board_that_cannot_be_an_accelerometers_is_told(options, words):
    with pytest.raises(InputError, match=words):
        load_device("adxl335-board", {"board": {"driver": "labjack-u6", **options}})


@pytest.mark.parametrize(
    ("driver", "role", "options", "words"),
    [
        ("openhaptics", "handle", {"stiffness_n_mm": 1.0}, "is not a key; allowed are axes"),
        ("openhaptics", "handle", {"force_limit_n": [1.0, 0.0, 3.0]}, "force_limit_n"),
        ("ur", "force_sensor", {"host": "a", "origin_mm": [0, 0, 0]}, "origin_mm"),
        *[
            (driver, role, options, words)
            for driver in ("inverse3", "virtual-inverse3")
            for role, options, words in (
                ("handle", {"address": "localhost:10001"}, "address"),
                ("handle", {"force_limit_n": 11.0}, "force_limit_n"),
                ("handle", {"lead_limit_mm": 5.0}, "lead_limit_mm is not a key; allowed are axes"),
                ("robot", {"force_limit_n": 2.0}, "force_limit_n is not a key; allowed are axes"),
                ("robot", {"axes": "x,y,-z"}, "mirrors"),
                ("robot", {"origin_mm": [0.0, math.nan, 0.0]}, "origin_mm"),
                ("robot", {"commands": "2.0"}, "commands"),
            )
        ],
    ],
)
def test_a_refused_option_of_a_role_is_named(driver, role, options, words):
    with pytest.raises(InputError, match=words):
        load_device(driver, options, role=role)
