"""What a peer sends is read or refused: hellos, ranges of frames, reasons."""

import contextlib

import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from link_samples import CHANNELS, hello

from mmt.core.errors import InputError
from mmt.link.protocol import (
    MAX_RANGES,
    FollowerHello,
    argument_of,
    encode_rejection,
    loss_of,
    ranges_of_payload,
    reason_of,
)

GOOD = hello().to_auth()
SEVERAL = {**GOOD, "protocol": 2, "samples_per_frame": 5}


def without(key):
    return {name: value for name, value in GOOD.items() if name != key}


@pytest.mark.parametrize(
    ("auth", "sentence"),
    [
        (None, "hello is missing"),
        ("follower", "hello is missing"),
        (without("protocol"), "lacks 'protocol'"),
        ({**GOOD, "protocol": 3}, "link protocol 3, the leader 1 and 2: install the same version"),
        ({**GOOD, "protocol": 2}, "lacks 'samples_per_frame'"),
        ({**SEVERAL, "samples_per_frame": 5.0}, "'samples_per_frame' is a float"),
        ({**GOOD, "protocol": True}, "'protocol' is a bool: allowed is int"),
        ({**GOOD, "rate_hz": 1000.0}, "'rate_hz' is a float"),
        ({**GOOD, "channels": "position"}, "'channels' is a str: allowed is list"),
        ({**GOOD, "channels": []}, "channels: none given"),
        ({**GOOD, "channels": ["smell", 3]}, "channels: 3, smell given, allowed are position"),
        ({**GOOD, "annotations": "text"}, "'annotations' is a str: allowed is bytes"),
        ({**GOOD, "clock_id": None}, "'clock_id' is a NoneType"),
    ],
)
def test_a_bad_hello_is_refused_with_a_sentence(auth, sentence):
    with pytest.raises(InputError) as caught:
        FollowerHello.from_auth(auth)
    assert sentence in str(caught.value)


@pytest.mark.parametrize(
    ("name", "least", "most"),
    [("frames_per_message", 1, 100), ("keep_frames", 0, 10**6), ("samples_per_frame", 1, 10)],
)
def test_numbers_of_a_hello_are_bounded(name, least, most):
    for value in (least, most):
        made = hello(channels=("acceleration",), rate_hz=500, **{name: value})
        read = FollowerHello.from_auth(made.to_auth())
        assert (read, getattr(read, name)) == (made, value)
        assert made.protocol == 1 + (made.samples_per_frame > 1)
    for value in (least - 1, most + 1):
        with pytest.raises(InputError, match=f"^{name} is {value}: allowed is {least} to {most}$"):
            hello(**{name: value})


@pytest.mark.parametrize("name", ["source", "clock_id", "run_id", "extra", "annotations"])
def test_texts_of_a_hello_are_bounded(name):
    filler, most = (b"x", 65_536) if name == "annotations" else ("x", 256)
    made = hello(**{name: filler * most})
    assert FollowerHello.from_auth(made.to_auth()) == made
    with pytest.raises(InputError, match=rf"^{name} .* {most} "):
        hello(**{name: filler * (most + 1)})


JSONISH = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.binary(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=8,
)


@given(st.one_of(JSONISH, st.fixed_dictionaries(dict.fromkeys(GOOD, JSONISH))), JSONISH)
@settings(max_examples=200)
def test_no_hello_whatever_breaks_the_leader(auth, one):
    variants = [auth] + [{**GOOD, key: one} for key in GOOD]
    for variant in variants:
        with contextlib.suppress(InputError):  # anything else is a fault
            read = FollowerHello.from_auth(variant)
            assert set(read.channels) <= {"position", "force", "acceleration"}
            assert read.source.isprintable()
            assert FollowerHello.from_auth(read.to_auth()) == read


def test_the_hello_puts_channels_in_the_frames_order():
    assert hello(channels=("force", "position")).channels == CHANNELS


@pytest.mark.parametrize(
    "payload",
    [
        *(None, b"", "ranges", [1, 2], [[1]], [[1, 2, 3]], [[2, 2]], [[3, 2]], [[-1, 2]]),
        *([[0, 2**32 + 1]], [[0.0, 2.0]], [["0", "2"]], [[0, 1]] * (MAX_RANGES + 1)),
    ],
)
def test_malformed_ranges_are_refused(payload):
    assert ranges_of_payload(payload) is None
    assert ranges_of_payload([[0, 1]] * MAX_RANGES) == [(0, 1)] * MAX_RANGES
    assert ranges_of_payload([[0, 2**32], (5, 6)]) == [(0, 2**32), (5, 6)]


def test_what_a_peer_says_is_printable_and_of_bounded_length():
    assert reason_of({"reason": "a\nb" * 100}) == reason_of({"reason": "a\nb" * 85 + "a"})
    assert reason_of({"reason": "x" * 257}) == "x" * 256
    assert reason_of({"reason": 5}) is reason_of({}) is reason_of("x") is None
    assert [argument_of(some) for some in ((), (1,), (1, 2))] == [None, 1, None]
    assert loss_of("ping timeout") == "it no longer answers"
    assert loss_of("fire") == "fire"


@pytest.mark.parametrize(
    ("reason", "hint"),
    [("not bytes", "as the one argument"), ("size", "have 40 bytes each"), ("late", "")],
)
def test_a_peer_is_told_what_to_send_instead(reason, hint):
    event, payload = msgpack.unpackb(encode_rejection("commands", reason, 3, 40))["data"]
    assert (event, payload["reason"], payload["times"]) == ("rejected", reason, 3)
    assert payload["text"].startswith(f"commands rejected: {reason}")
    assert payload["text"].endswith(hint or reason)
