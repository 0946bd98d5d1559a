"""Keys as words for people, with units as they are written."""

import pytest

from mmt.core.output.tables import label


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("rms_m_s2", "rms m/s²"),
        ("maximum_speed_mm_s", "maximum speed mm/s"),
        ("slew_m_s3", "slew m/s³"),
        ("slew_n_s", "slew N/s"),
        ("largest_damping_n_s_m", "largest damping N s/m"),
        ("contact_n", "contact N"),
        ("power error db", "power error dB"),
        ("rate_hz", "rate Hz"),
        ("late_share_1ms", "late share 1ms"),
        ("latency_p50_ms", "latency p50 ms"),
        ("n", "n"),
        ("stations", "stations"),
    ],
)
def test_a_key_becomes_words_with_its_unit_as_it_is_written(key, words):
    assert label(key) == words
