"""Units have the factors of the standards, however they are written."""

import pytest
from unit_samples import FOREIGN, UNITS

from mmt.core.units import _table, is_unit, unit_factor, unit_in_name


@pytest.mark.parametrize(
    ("quantity", "name", "unit"),
    [
        *(("speed", name, "") for name in ("data.v", "tool_v", "a.g", "mm_s", "V", "")),
        *(
            ("speed", f"{name}{unit}", unit)
            for name in ("F_", "F a-b.", "F a-b ")
            for unit in ("V", "mV", "m_s")
        ),
        *(("position", name, "mm") for name in ("x (mm)", "a[0] [mm]", "x.mm", f"{'a' * 999}-mm")),
        ("position", "x {mm}", "{mm}"),
        *(
            ("force", name, unit)
            for unit in ("N", "g", "mN")
            for name in (f"F_{unit}", f"F[1]({unit})")
        ),
        *(("time", name, "") for name in ("t_d", "F_h", "time", "s", "t[d", "")),
        *(("time", f"{name}Ms", "Ms") for name in ("time", "t ")),
    ],
)
def test_a_unit_is_in_brackets_or_ends_a_name(quantity, name, unit):
    assert unit_in_name(quantity, name) == unit


PREFIXES = {"": 1.0, "n": 1e-9, "u": 1e-6, "\u00b5": 1e-6, "m": 1e-3, "c": 1e-2, "d": 0.1, "k": 1e3}
IN_FULL = {"": 1.0, "nano": 1e-9, "micro": 1e-6, "milli": 1e-3, "centi": 1e-2, "kilo": 1e3}
SYMBOLS = {"time": "s sec", "position": "m", "force": "N gf dyn", "acceleration": "Gal g gn"}
WORDS = {"time": "second", "position": "meter metre", "force": "newton gram dyne"}
SIZES = {"m": 1e3, "gf": 9.80665e-3, "gram": 9.80665e-3, "dyn": 1e-5, "dyne": 1e-5, "Gal": 1e-2}
SIZES |= {"g": 9.80665, "gn": 9.80665, "meter": 1e3, "metre": 1e3}
OTHERS = {
    "time": {"date": 1.0, "mins": 60.0, "hr": 3600.0, "Days": 86400.0, "s since 1970-01-01": 1.0},
    "position": {"foot": 304.8, "\u2033": 25.4, "thou": 0.0254, "microns": 1e-3, "NM": 1e-6},
    "force": {"klbf": 4448.2216152605, "kp": 9.80665, "MN": 1e6, "[N]": 1.0, "N.": 1.0},
    "acceleration": {
        "m\u00b7s\u207b\u00b2": 1.0,
        "in/s/s": 0.0254,
        "m/min2": 1 / 3600,
        "g_n": 9.80665,
        "m_s2": 1.0,
    },
    "speed": {"m/s": 1e3, "mm per s": 1.0, "m s-1": 1e3, "in_min": 25.4 / 60, "cm/s": 10.0},
}
NONE = {"speed": ("ms", "m/s2"), "acceleration": ("ms", "m/s", "m/s/sec"), "position": ("Nm",)}


@pytest.mark.parametrize("quantity", OTHERS)
def test_units_have_the_factors_of_the_standards(quantity):
    _table.cache_clear()  # it is built here
    units = {**UNITS.get(quantity, {}), **OTHERS[quantity]}
    for prefixes, bases, plural in ((PREFIXES, SYMBOLS, ""), (IN_FULL, WORDS, "s")):
        for base in bases.get(quantity, "").split():
            for prefix, size in prefixes.items():
                units[prefix + base] = units[prefix + base + plural] = size * SIZES.get(base, 1.0)
    for unit, factor in units.items():
        for spelled in (unit, f" {unit} ", unit.lower() if unit != "MN" else unit):
            assert unit_factor(quantity, spelled) == pytest.approx(factor, rel=1e-9)
        assert is_unit(unit)
    for unit in ("", "x", "kgm", "1", "/", "m/s3", "N/m", f"mm{' ' * 99}"):
        assert unit_factor(quantity, unit) is None
        assert not is_unit(unit)
    for unit in (*FOREIGN.values(), *NONE.get(quantity, ())):
        assert unit_factor(quantity, unit) is None
    assert all(map(is_unit, FOREIGN.values()))
