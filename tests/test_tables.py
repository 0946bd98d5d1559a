"""Numbers for people, and keys as words, with units as they are written."""

import pytest

from mmt.core.output.tables import as_text, label

WORDS = {
    "rms_m_s2": "rms m/s²",
    "maximum_speed_mm_s": "maximum speed mm/s",
    "slew_m_s3": "slew m/s³",
    "slew_n_s": "slew N/s",
    "largest_damping_n_s_m": "largest damping N s/m",
    "contact_n": "contact N",
    "power error db": "power error dB",
    "rate_hz": "rate Hz",
    "late_share_1ms": "late share 1ms",
    "latency_p50_ms": "latency p50 ms",
    "n": "n",
    "stations": "stations",
}


@pytest.mark.parametrize("key", WORDS)
def test_a_key_becomes_words_with_its_unit_as_it_is_written(key):
    assert label(key) == WORDS[key]


@pytest.mark.parametrize(
    ("value", "text"),
    [(9999.8, "10000"), (10_000.0, "10000"), (999.94, "999.9"), (0.00123456, "0.001235"),
     (123_456.7, "123457"), (2.5e7, "2.5e+07"), (True, "yes")],
)  # fmt: skip
def test_numbers_stand_without_exponents_up_to_a_million(value, text):
    assert as_text(value) == text
