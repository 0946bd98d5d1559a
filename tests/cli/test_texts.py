"""Numbers for people."""

import pytest

from mmt.core.output.tables import as_text


@pytest.mark.parametrize(
    ("value", "text"),
    [(9999.8, "10000"), (10_000.0, "10000"), (999.94, "999.9"), (0.00123456, "0.001235"),
     (123_456.7, "123457"), (2.5e7, "2.5e+07"), (True, "yes")],
)  # fmt: skip
def test_numbers_stand_without_exponents_up_to_a_million(value, text):
    assert as_text(value) == text
