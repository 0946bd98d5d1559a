"""What looks wrong in an import is said, with figures and the option that mends it."""

from dataclasses import replace

import numpy as np
import pytest

from mmt.core.frames import FIELD_OF_CHANNEL, frame_dtype
from mmt.session.importing.checks import ChannelReport, assess, unit_by_gravity, unit_by_speed
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.samples import Samples
from mmt.session.importing.stamps import Stamps

ROWS = 2000
N = np.arange(ROWS)
POSITION_MM = np.column_stack([0.125 * N, 0 * N + 50, 0 * N - 100])
FORCE_N = np.column_stack([3.0 * (N == 7), 0 * N + 0.1, np.linspace(0.25, 0.75, ROWS)])


def shaken(mean, size=1.0):
    """Return an acceleration (n, 3) that alternates by a size along x, about a mean along z."""
    return np.column_stack([size * (-1.0) ** N, 0 * N, 0 * N + mean])


SOUND = {"position": POSITION_MM, "force": FORCE_N, "acceleration": shaken(9.81)}


def clock(rate_hz=1000.0, rows=ROWS, **others):
    exact = Stamps(np.arange(rows) / rate_hz, 1 / rate_hz, 0.0, 0.0, 0, periodic=True, regular=True)
    return replace(exact, **others)


def report_of(
    values, options=None, clocks=None, *, framed=None, numbers=None, several=1, resampled=True
):
    """Assess channels, by default at 1 kHz; their frames hold other values or numbers if given."""
    count = len(next(iter(values.values())))
    numbers = np.arange(count) if numbers is None else numbers
    frames = np.zeros(len(numbers), frame_dtype(values, several))
    frames["sequence"] = numbers
    for channel, vectors in {**values, **(framed or {})}.items():
        if channel != "acceleration":
            frames[FIELD_OF_CHANNEL[channel]] = vectors
    stamps = {**dict.fromkeys(values, clock(rows=count)), **(clocks or {})}
    samples = Samples(values, {}, {}, told=frozenset({"force"}))
    return assess(frames, samples, stamps, options or ImportOptions(), resampled=resampled)


def changed(vectors, row, value):
    """Return vectors (n, 3) with another value along z in a row."""
    vectors = vectors.copy()
    vectors[row, 2] = value
    return vectors


def moved(jump_mm, row):
    """Return a motion of 50 rows by an eighth of a millimetre, that jumps at a row."""
    return POSITION_MM[:50] + np.outer(np.arange(50) >= row, [jump_mm, 0, 0])


def held(repeats):
    values = shaken(9.81)
    values[100 : 101 + repeats] = values[100]
    return values


def clipped(rows, following):
    """Return a force of 1000 rows, of which some stand at its largest value, some at the next."""
    largest = np.repeat([0.9, 0.8], [rows, following])
    return np.pad(
        np.r_[largest, np.linspace(0.2, 0.7, 1000 - len(largest))][:, None], [(0, 0), (2, 0)]
    )


def test_a_recording_is_described():
    position = np.array([[1.0, 2.0, -3.0], [1.25, 2.0, -3.0]])
    stamps = clock(500.0, rows=2, jitter_s=2**-10, missing_rows=7)
    found = report_of({"position": position}, clocks={"position": stamps})
    low, mean, high = ((x, 2.0, -3.0) for x in (1.0, 1.125, 1.25))
    assert found.channels == (ChannelReport("position", 2, 500.0, 0.9765625, 7, low, mean, high),)
    assert found.speed_mm_s == pytest.approx(250)
    assert found.told == {"force"}
    assert report_of({"force": FORCE_N}).speed_mm_s is None


@pytest.mark.parametrize(
    ("numbers", "x_mm", "speed_mm_s"),
    [
        ([4], [7.0], 0.0),
        (N + N // 3, 0.125 * (N + N // 3), 125),
        (N, 0.125 * N + 15 * (N > 1995), 125),
    ],
)
def test_the_speed_is_that_of_99_frames_in_a_hundred(numbers, x_mm, speed_mm_s):
    framed = {"position": np.outer(x_mm, [0.6, 0.8, 0.0])}
    found = report_of({"position": POSITION_MM}, framed=framed, numbers=numbers)
    assert found.speed_mm_s == pytest.approx(speed_mm_s, rel=1e-3)


FAST = (
    "position: the speed exceeds 2500 mm/s in one frame of a hundred, a hand strokes at 20 to "
    "500; is it in um{}, or look at the times"
)
SLOW = (
    "position: it spans 0.5 mm, and the speed seldom exceeds 0.25 mm/s; is it in m? Then say "
    "--unit position=m"
)
JUMP = (
    "position: it jumps by {} mm at row {}, and {} times in all; --missing VALUE --blanks-as-gaps "
    "leaves out what stands for no position"
)


@pytest.mark.parametrize(
    ("position", "units", "expected"),
    [
        (0 * POSITION_MM + 3, {}, "position: it never changes; is it the right column?"),
        (POSITION_MM * 20, {}, FAST.format("? Then say --unit position=um")),
        (POSITION_MM * 20, {"position": "um"}, FAST.format(", as --unit says?")),
        (POSITION_MM * 16, {}, None),
        (POSITION_MM / 500, {}, SLOW),
        (changed(POSITION_MM, 1996, -9999.0), {}, JUMP.format(9899, 1997, 2)),
        (moved(15.875, 49), {}, JUMP.format(16, 50, 1)),
        (moved(9.875, 25), {}, None),
    ],
)
def test_a_position_that_no_hand_takes_is_said(position, units, expected):
    found = report_of({"position": position}, ImportOptions(units=units)).warnings
    assert found == (() if expected is None else (expected,))


def test_a_slow_motion_and_one_in_a_pause_are_no_faults():
    assert report_of({"position": POSITION_MM * 16}, numbers=1000 * N).warnings == ()
    paused = replace(clock(), time_s=N[:50] / 1000 + (N[:50] >= 25))
    found = report_of({"position": moved(15.0, 25)}, clocks={"position": paused})
    assert found.warnings == ()


CONTACT_N = np.where(N[:, None] % 2, [0.1, 0.0, 0.0], np.c_[0 * N, 2 + N // 2 % 2, 0 * N + 1])
SIDEWAYS = (
    "force: in contact it points along y ((0, 2.5, 1) N on average), where z is taken for the "
    "surface's normal; map the axes anew (position and acceleration too), or set normal in the "
    "scene's [texture]"
)
LARGE = (
    "force: it exceeds 99 N, a hand presses with 0.2 to 10; is it in mN? Then say --unit force=mN"
)
COUNTS = (
    "force: it exceeds 1.98e+06 N, a hand presses with 0.2 to 10; counts become N by a factor, as "
    "in --map force_z=NAME*1e-6"
)
SMALL = "force: it stays below 0.02 N, so nothing is touched; is it in kN? Then say --unit force=kN"
PULLING = (
    "force: z is -0.5 N on average in contact; it must be the surface's force on the tool, away "
    "from the surface: --map force=-force_n"
)
OUTLIER = (
    "force: z is {} in row 701, nearly all others are below 0.75; --missing VALUE "
    "--blanks-as-gaps leaves it out"
)
DEAD = "{}: it never changes; is it the right column, and was the sensor on?"
CLIPPED = "force: z stands at 0.9 in {} rows, the end of its range?"


@pytest.mark.parametrize(
    ("force", "expected"),
    [
        (np.outer(np.linspace(0, 100, ROWS), [0, 0, 1]), LARGE),
        (np.outer(np.linspace(0, 2e6, ROWS), [0, 0, 1]), COUNTS),
        (np.outer(np.linspace(0, 0.02, ROWS), [0, 0, 1]), SMALL),
        (-FORCE_N, PULLING),
        (CONTACT_N, SIDEWAYS),
        (np.c_[0 * N, 0 * N + 2, 0.75 + N % 2 / 2], None),
        (0 * FORCE_N + 3, DEAD.format("force")),
        (changed(FORCE_N, 700, 505831.25), OUTLIER.format(505831.25)),
        (changed(FORCE_N, 700, -100), OUTLIER.format(-100)),
        (changed(FORCE_N, range(700, 706), 99.0), OUTLIER.format(99).replace("0.75", "0.747")),
        (clipped(6, 1), CLIPPED.format(6)),
        (clipped(5, 1), None),
        (clipped(11, 2), CLIPPED.format(11)),
        (clipped(10, 2), None),
        (FORCE_N[N // 2] * [0, 1, 1], None),
        (FORCE_N[:100], None),
        (FORCE_N[[0, -1]], None),
    ],
)
def test_a_force_that_no_hand_feels_is_said(force, expected):
    found = report_of({"force": force}).warnings
    assert found == (() if expected is None else (expected,))


def test_a_force_in_the_tools_axes_is_judged_as_it_is_turned():
    options = ImportOptions(tool_axes=("force",))
    assert report_of({"force": CONTACT_N}, options, framed={"force": FORCE_N}).warnings == ()
    assert report_of({"force": FORCE_N}, framed={"force": CONTACT_N}).warnings == ()


@pytest.mark.parametrize(
    ("columns", "proposed"),
    [
        ({"force": "F"}, "--map force=-F"),
        (
            {"force_x": "-a", "force_y": "b", "force_time": "t", "time": "s", "position": "p"},
            "--map force_x=a --map force_y=-b",
        ),
    ],
)
def test_what_inverts_a_force_is_said_with_its_columns(columns, proposed):
    found = report_of({"force": -FORCE_N}, ImportOptions(columns)).warnings
    assert found[0].endswith(f"away from the surface: {proposed}")


@pytest.mark.parametrize(("bits", "factor"), [(16, 1.0), (16, 0.0048), (24, 1e-6)])
def test_negative_numbers_without_their_sign_are_said(bits, factor):
    counts = np.rint(30 * np.random.default_rng(1).standard_normal((ROWS, 3)))
    unsigned = report_of({"force": factor * (counts % 2**bits)}).warnings
    assert all(any(f"force: {a} leaps to and fro" in each for each in unsigned) for a in "xyz")
    for signed in (counts, np.where(N[:, None] < 900, counts, counts + 2**bits), counts % 200):
        assert not any("leaps" in each for each in report_of({"force": factor * signed}).warnings)


MEAN = "acceleration: its mean is {} m/s2 long; gravity is 9.81, and none is 0: "
IN_UNIT = MEAN + "is it in {}? Then say --unit acceleration={}"
SCALED = MEAN + (
    "its offset or its scale is wrong; counts become m/s2 by a factor, as in "
    "--map acceleration_x=NAME*0.0006"
)
STILL = "acceleration: it varies by 0.01 m/s2 rms only; is it in g? Then say --unit acceleration=g"
HALF = (
    "acceleration: most rows repeat the one before, so it has about 500 values a second, not 1000; "
    "import its own times, or its rows alone"
)


@pytest.mark.parametrize(
    ("acceleration", "expected"),
    [
        (shaken(1), IN_UNIT.format(1, "g", "g")),
        (shaken(1000), IN_UNIT.format("1e+03", "mg", "mg")),
        *((shaken(mean), SCALED.format(mean)) for mean in (2.5, 7.5, 12)),
        *((shaken(mean), None) for mean in (0, 2, 8, 11.5)),
        (shaken(9.81, 0.01), STILL),
        (shaken(9.81, 0.06), None),
        (shaken(9.81, 0), DEAD.format("acceleration")),
        (held(50), None),
        (held(52), "acceleration: it held one value for 0.052 s"),
        (shaken(9.81)[N // 2], HALF),
    ],
)
def test_an_acceleration_that_no_sensor_measures_is_said(acceleration, expected):
    found = report_of({"acceleration": acceleration}).warnings
    assert found == (() if expected is None else (expected,))


@pytest.mark.parametrize(
    ("rate_hz", "asked", "expected"),
    [
        (500, None, "at 500 Hz nothing above 250 Hz is in it; texture is felt up to 500 Hz"),
        (2000, 4000, "at 2000 Hz nothing above 1000 Hz is in it"),
        (710, None, None),
        (3970, 4000, None),
    ],
)
def test_an_acceleration_slower_than_texture_or_than_what_is_asked_for_is_said(
    rate_hz, asked, expected
):
    clocks = {"acceleration": clock(rate_hz)}
    options = ImportOptions(acceleration_rate_hz=asked)
    found = report_of(
        {"acceleration": shaken(9.81)}, options, clocks, several=4 if asked else 1
    ).warnings
    assert found == (() if expected is None else (f"acceleration: {expected}",))


@pytest.mark.parametrize(
    ("rate_hz", "several", "amplitudes", "rows", "expected"),
    [
        (8000, 1, {1234.5: 1}, 8000, "100 500: --acceleration-rate 8000 keeps it to 4000 Hz"),
        (8000, 1, {1234.5: 1}, 100, "100 500: --acceleration-rate 8000 keeps it to 4000 Hz"),
        (
            5500,
            1,
            {100.3: 1, 1234.5: 0.5},
            8000,
            "20 500: --acceleration-rate 6000 keeps it to 3000 Hz",
        ),
        (40_000, 10, {9000.3: 1}, 8000, "100 5000"),
        (8000, 1, {100.3: 1, 1234.5: 0.05}, 8000, None),
        (8000, 1, {400.7: 1}, 8000, None),
        (8000, 3, {1234.5: 1}, 8000, None),
        (1005, 1, {502.1: 1}, 8000, None),
    ],
)
def test_vibration_above_the_band_that_is_kept_is_said(
    rate_hz, several, amplitudes, rows, expected
):
    time_s = np.arange(rows) / rate_hz
    tone = sum(size * np.sin(2 * np.pi * hz * time_s) for hz, size in amplitudes.items())
    values = {"acceleration": np.outer(tone, [1, -1, 2])}
    clocks = {"acceleration": clock(rate_hz)}
    found = report_of(values, None, clocks, several=several).warnings
    share, _, rest = (expected or "").partition(" ")
    hertz, colon, keeps = rest.partition(":")
    said = f"acceleration: {share} % of its power is above {hertz} Hz and is left out{colon}{keeps}"
    assert found == (() if expected is None else (said,))
    assert report_of(values, None, clocks, several=several, resampled=False).warnings == ()


OFF = "the stamps lie 0.60 ms rms, 1.5 ms at most off a clock of 500.0 Hz"


@pytest.mark.parametrize(
    ("periodic", "regular", "expected"),
    [
        (True, True, f"{OFF}; the rows were put at its times (--stamps kept takes the stamps)"),
        (
            True,
            False,
            f"{OFF}, but the rows fit the stamps better, which were kept (--stamps regular takes "
            "the clock)",
        ),
        (
            False,
            False,
            "the intervals are uneven (0.60 ms rms, 1.5 ms at most) and follow no clock; the "
            "stamps were taken as they are, and speeds are as uncertain as they",
        ),
    ],
)
def test_jitter_and_missing_rows_are_said_once_for_the_channels_of_a_clock(
    periodic, regular, expected
):
    kinds = {"periodic": periodic, "regular": regular}
    jittered = clock(500.0, jitter_s=6e-4, largest_s=1.5e-3, **kinds)
    clocks = {
        "position": jittered,
        "force": jittered,
        "acceleration": clock(jitter_s=0.05 * 1e-3, missing_rows=3),
    }
    missing = "acceleration: 3 rows are missing by the stamps"
    assert report_of(SOUND, clocks=clocks).warnings == (f"position, force: {expected}", missing)
    assert report_of(SOUND, clocks=clocks, resampled=False).warnings == (missing,)


def test_channels_that_share_little_time_are_said():
    far = {"acceleration": clock(rate_hz=1.0), "force": clock(), "position": clock()}
    found = report_of(SOUND, clocks=far).warnings
    assert any(text.startswith(f"{ROWS / 1000:g} s of {ROWS - 1} s are in all") for text in found)


@pytest.mark.parametrize(
    ("mean_m_s2", "unit"),
    [
        *((mean, None) for mean in (0.75, 0.8, 1.2, 1.25, 799, 800, 1200, 1201)),
        *((mean, "g") for mean in (0.9, 1.1)),
        *((mean, "mg") for mean in (801, 1199)),
    ],
)
def test_a_unit_is_told_by_gravity(mean_m_s2, unit):
    assert unit_by_gravity(mean_m_s2) == unit


@pytest.mark.parametrize(
    ("speed_mm_s", "unit"), [(0.001, None), (0.002, None), (0.003, "m"), (1.9, "m"), (2.0, None)]
)
def test_a_unit_is_told_by_the_speed_of_a_hand(speed_mm_s, unit):
    assert unit_by_speed(speed_mm_s) == unit
