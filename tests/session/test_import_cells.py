"""Cells of tables are the numbers, dates and times that they show."""

from datetime import UTC, date, datetime, time, timedelta
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.core.errors import InputError
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.readers import cells

FORMS = "%Y-%m-%d %H:%M:%S.%f|%Y-%m-%dT%H:%M:%S.%fZ|%Y-%m-%d %H:%M:%S+02:00|%d.%m.%Y %H:%M:%S,%f"
FORMS += "|%d.%m.%Y %H:%M:%S|%Y/%m/%d %H:%M:%S.%f| %H:%M:%S.%f |%H:%M|%M:%S.%f|%I:%M:%S %p"
FORMS += "|%m/%d/%Y %I:%M:%S %p|%m/%d/%Y %I:%M:%S.%f %p"
FORMS += "|%I:%M:%S.%f %p|0 days %H:%M:%S.%f|7 days, +%H:%M:%S"


@given(st.datetimes(datetime(1901, 1, 1), datetime(2200, 1, 1)), st.sampled_from(FORMS.split("|")))
def test_dates_and_times_are_read_in_the_forms_of_common_programs(moment, form):
    shown = datetime.strptime(f"{moment:{form}}", form)
    seconds = (shown - datetime(1970 if "%Y" in form else 1900, 1, 1)).total_seconds()
    seconds += 7 * 86400 * ("7 days" in form) - 7200 * ("+02" in form)
    assert cells.Numbers(ImportOptions())(f"{moment:{form}}") == pytest.approx(seconds, abs=1e-5)
    assert cells.seconds_of(moment) == pytest.approx(
        (moment - datetime(1970, 1, 1)).total_seconds()
    )
    of_day = moment - datetime.combine(moment, time.min)
    for cell in (of_day, moment.replace(tzinfo=UTC).timetz()):
        assert cells.seconds_of(cell) == of_day.total_seconds()


def test_what_is_no_date_is_none():
    assert not any(map(cells.seconds_of, ("12", "1:2:3:4", "7 days, a:b", "25:00", "x:y")))


@settings(max_examples=30)
@given(
    thousands=st.lists(st.integers(1, 999_999), min_size=2),
    decimals=st.integers(2, 4),
    missing=st.sampled_from([(), ("x",)]),
)
def test_a_comma_is_a_decimal_sign_only_where_it_must_be(thousands, decimals, missing):
    number = cells.Numbers(ImportOptions())
    for value in thousands:
        number(f"{value:,}")
    if max(thousands) < 1000:
        number.check()
    else:
        with pytest.raises(InputError, match="--decimal"):
            number.check()
    number = cells.Numbers(ImportOptions(missing=missing))
    found = [number(f"{v / 1000:.{decimals}f}".replace(".", ",")) for v in (1, *thousands)]
    number.check()
    np.testing.assert_allclose(found, np.array([1, *thousands]) / 1000, atol=0.51 / 10**decimals)
    for cell in ("7", 2.5, "1.5"):
        number.check()
        number(cell)
    with pytest.raises(InputError, match=r"with a point.*--decimal"):
        number.check()


@settings(max_examples=30)
@given(st.lists(st.floats(-1e9, 1e9), min_size=1), st.integers(0, 5), st.booleans())
def test_a_sign_before_thousands_is_known_by_the_other_before_decimals(values, decimals, german):
    swapped = str.maketrans(",.", ".,")
    texts = [f"{value:,.{decimals}f}" + "." * (not decimals) for value in [1234.5, *values]]
    number = cells.Numbers(ImportOptions())
    found = [number(text.translate(swapped) if german else text) for text in texts]
    number.check()
    np.testing.assert_allclose(found, [1234.5, *values], atol=0.51 / 10**decimals)


@given(st.floats(-1e9, 1e9), st.integers(0, 3))
def test_numbers_are_read_as_programs_spell_them(value, decimals):
    text = f"{value:.{decimals}f}"
    grouped = f"{value:,.{decimals}f}"
    spelt = [text.replace("-", "\u2212"), f"np.float64({text})", f"tensor({text})"]
    spelt += [grouped.replace(",", sign) for sign in ("'", "\u2019", "\u202f", "\xa0")]
    spelt += [f"{float(text):.17E}".replace("E", letter) for letter in "dD"]
    for cell in spelt:
        assert cells.Numbers(ImportOptions())(cell) == float(text)
        assert cells.Numbers(ImportOptions(decimal="."))(cell) == float(text)


@pytest.mark.parametrize(
    ("texts", "numbers"),
    [
        (["1.234.567", "0,5", "12"], [1234567, 0.5, 12]),
        (["1,234,567", "0.5", "12"], [1234567, 0.5, 12]),
        (["999.000", "1.000.000"], None),
        (["999,000", "1,000,000"], None),
        (["-1.000.000", "0.5"], None),
    ],
)
def test_several_signs_of_one_kind_are_those_of_thousands(texts, numbers):
    number = cells.Numbers(ImportOptions())
    found = list(map(number, texts))
    if numbers is None:
        with pytest.raises(InputError, match="--decimal"):
            number.check()
    else:
        number.check()
        assert found == numbers


@given(
    st.sampled_from([*sorted(cells.MISSING), "1.#QNAN", "-1.#IND", "nan(ind)", "9999", "lost"]),
    st.sampled_from([str.upper, str.lower, " {} ".format]),
    st.sampled_from([None, ".", ","]),
)
def test_what_marks_a_missing_value_is_no_number_and_no_text(word, change, decimal):
    options = ImportOptions(missing=(" 9999", "Lost "), decimal=decimal)
    number = cells.Numbers(options)
    given_cells = [change(word), "seven", None, 3, 2.5, Decimal("1.25"), timedelta(minutes=2)]
    assert [*map(number.takes, given_cells)] == [True, False, True, True, True, True, True]
    assert [*map(number.reads, given_cells)] == [False, False, False, True, True, True, True]
    assert [*map(number, [change(word), *given_cells[2:]])] == [None, None, 3.0, 2.5, 1.25, 120.0]
    assert cells.weigh_numbers([["1", "x", change(word)], ["a", "b"], ["2", "3"]] * 2, options) == 4


@given(st.floats(-1e9, 1e9), st.booleans(), st.sampled_from([0, 3]))
def test_the_decimal_sign_that_is_said_wins(value, comma, decimals):
    text = f"{value:,.{decimals}f}".translate(str.maketrans(",.", ".,") if comma else {})
    number = cells.Numbers(ImportOptions(decimal="," if comma else "."))
    assert number(text) == pytest.approx(value, abs=0.51 / 10**decimals)
    number.check()


@given(st.sampled_from(["D", "m", "s", "ms", "us", "ns"]), st.sampled_from(["M8", "m8"]))
def test_arrays_of_any_type_are_their_numbers(tick, kind):
    counts = np.arange(1, 18)[:, None] * [1, 2]
    ticks = counts.astype(f"{kind}[{tick}]")
    ticks[3, 1] = "NaT"
    arrays = {"t": ticks.T, "n": counts.astype("S"), "w": counts[:, :1], "texts": ["01:00"]}
    arrays |= {"few": np.ones((16, 17)), "many": np.ones((17, 18))}
    found = cells.columns_of(arrays, {"n": "mm", "t": "mm"})
    seconds = counts * (np.timedelta64(1, tick) / np.timedelta64(1, "s"))
    np.testing.assert_allclose(found["values"].pop("t"), np.where(np.isnat(ticks), np.nan, seconds))
    np.testing.assert_array_equal(found["values"].pop("n"), counts)
    shapes = [values.shape for values in found["values"].values()]
    assert shapes == [(17,), (1,), (17, 16), (17, 18)]
    assert found["units"] == {"n": "mm", "t": "date", "texts": "date"}


@pytest.mark.parametrize(
    "values", [["1", "x"], [date(2026, 1, 31)], [{}], [1j], [b"\xff", b"1"], ["1,000", "1.5"]]
)
def test_an_array_of_something_else_is_refused_by_name(values):
    with pytest.raises(InputError, match=r"^F\b"):
        cells.columns_of({"F": values})


@settings(max_examples=30)
@given(
    st.lists(st.integers(-(2**31), 2**31 - 1), min_size=2),
    st.sampled_from([8, 16]),
    st.sampled_from([str.upper, str.lower]),
)
def test_hexadecimal_cells_are_of_the_width_they_are_written_in(values, digits, change):
    texts = [f"0x{change(f'{v & (16**digits - 1):0{digits}x}')}" for v in values]
    found, unit = cells.numbers_in(texts, "a")
    assert unit == ""
    np.testing.assert_array_equal(found, values)
    with pytest.raises(InputError, match=r"a are written with 0x and .* or with 0x and 3 digits"):
        cells.numbers_in([*texts, "0x123"], "a")


@settings(max_examples=30)
@given(
    st.lists(st.floats(-1e6, 1e6), min_size=2),
    st.sampled_from(["N", "mm", "m/s²", "µm", "g", "counts", "V"]),
    st.sampled_from(["", " ", "\u202f"]),
    st.sampled_from(["{:.4f}", "{:.4e}", "{:+.3f}"]),
    st.sampled_from(["mN", ""]),
)
def test_a_unit_in_every_cell_is_that_of_the_column(values, unit, blank, form, other):
    texts = [form.format(value) + blank + unit for value in values]
    found, told = cells.numbers_in([*texts, ""], "a")
    assert told == unit
    np.testing.assert_array_equal(found[:-1], [float(form.format(v)) for v in values])
    assert np.isnan(found[-1])
    with pytest.raises(InputError, match="numbers of a are written with"):
        cells.numbers_in([*texts, f"1{other}"], "a")


@pytest.mark.parametrize(
    ("texts", "told"),
    [
        (["1,5", "1.25"], r"with a comma \(1,5\) and with a point: say which is the decimal sign "),
        (
            ["1,500"],
            r"with a comma \(1,500\) and no other decimals: say which is the decimal sign ",
        ),
    ],
)
def test_decimals_that_are_uncertain_are_told(texts, told):
    number = cells.Numbers(ImportOptions())
    for text in texts:
        number(text)
    with pytest.raises(InputError, match=rf"^there are numbers {told}\(--decimal \. or "):
        number.check()


def test_columns_of_texts_are_labels():
    arrays = {"who": np.array([b" acc ", b"", b"g"]), "z": np.array(["1 N", "2 N"])}
    found = cells.columns_of(arrays, {"z": "mN", "who": "V"})
    assert found["labels"]["who"].tolist() == ["acc", "", "g"]
    assert found["values"]["z"].tolist() == [1.0, 2.0]
    assert found["units"] == {"z": "N", "who": "V"}
    with pytest.raises(InputError, match=r"^who does not hold numbers"):
        cells.columns_of({"who": np.array(["a", "1"])})
    with pytest.raises(InputError, match=r"^who does not hold numbers"):
        cells.columns_of({"who": np.array([["a", "b"]])})
    with pytest.raises(InputError, match=r"^the numbers of z are written with N or with m"):
        cells.columns_of({"z": np.array(["1 N", "2 mN"])})
    with pytest.raises(InputError, match=r"written with N or with nothing: write all alike$"):
        cells.columns_of({"z": np.array(["1 N", "2"])})


def test_complex_arrays_without_imaginary_parts_are_real():
    found, unit = cells.numbers_in(np.array([1 + 0j, 2]), "f")
    assert (found.tolist(), found.dtype, unit) == ([1.0, 2.0], np.float64, "")
    with pytest.raises(InputError, match=r"^f "):
        cells.numbers_in(np.array([1 + 1j]), "f")


@pytest.mark.parametrize("text", ["1_000", "_1", "rubbish", "0xFG", "1.5 furlongs"])
def test_texts_that_are_no_numbers_are_named(text):
    with pytest.raises(ValueError, match=f"^{text}$"):
        cells.Numbers(ImportOptions())(text)
