"""A Haptuator at an emulated sound card: what is heard, what is counted, what goes wrong."""

import builtins
import math
import sys
import types
from importlib.machinery import ModuleSpec

import numpy as np
import pytest
from waiting import check_refused

from mmt.core.errors import DeviceLost, InputError, MmtError
from mmt.devices.drivers import load_device
from mmt.devices.haptuator.sound import SoundHaptuator, SoundOptions, load_sounddevice
from mmt.testing.emulated.sound_card import EmulatedSoundCard

OPTIONS = {"volts_per_m_s2": 0.1, "full_scale_v": 6.0}


def haptuator(card, **changes):
    options = SoundOptions.model_validate({**OPTIONS, **changes})
    return SoundHaptuator(options, card, card.clock_ns)


def play(device, card, seconds):
    for k in range(round(1000 * seconds)):
        device.write([10.0 * math.sin(2.0 * math.pi * 250.0 * k / 1000.0 + 0.3)])
        card.advance(0.001)


@pytest.mark.parametrize(("k", "tone_hz"), [(1, 250.0), (2, 250.0), (5, 1500.0), (10, 3000.0)])
def test_a_tone_is_heard_at_its_frequency_and_level_on_its_channel_alone(k, tone_hz, connected):
    card = EmulatedSoundCard(clock_ppm=200.0)
    device = haptuator(card, low_hz=20.0, high_hz=5000.0, channel=2)
    device.set_rate(1000.0 * k)
    connected(device)
    wanted = 10.0 * np.sin(2.0 * math.pi * tone_hz * np.arange(2000 * k) / (1000.0 * k))
    for tick in wanted.reshape(2000, k):
        device.write(tick)
        card.advance(0.001)
    heard_v = 6.0 * card.played(2)[-48_000:]
    assert not card.played(1).any()
    spectrum = np.abs(np.fft.rfft(heard_v * np.hanning(48_000)))
    assert np.argmax(spectrum) == pytest.approx(tone_hz, abs=2.0)  # in Hz, by the card's own clock
    assert np.sqrt(np.mean(heard_v**2)) == pytest.approx(math.sqrt(0.5), rel=0.03)
    statistics = device.statistics
    assert statistics.samples == 2000 * k
    assert (statistics.underruns, statistics.slips, statistics.clipped) == (0, 0, 0)
    gain, low_hz = device.response(np.array([tone_hz]))
    assert gain == pytest.approx(np.sqrt(np.mean(heard_v**2)) / math.sqrt(0.5), rel=0.03)
    assert low_hz == 20.0


def test_the_latency_stated_is_the_one_that_passes(connected):
    card = EmulatedSoundCard(dac_latency_s=0.004)
    device = connected(haptuator(card, low_hz=1.0))
    for k in range(1000):
        device.write([10.0 if k == 900 else 0.0])
        card.advance(0.001)
    # frames are asked for at the end of the time that passes; the converter is 4 ms later
    frame = int(np.argmax(np.abs(card.played())))
    passed_ms = frame / 48.0 + 2.0 + 4.0 - 900.0
    assert device.statistics.latency_ms == pytest.approx(passed_ms, abs=1.5)


def test_no_frame_is_beyond_the_limit_between_the_samples_either(connected):
    card = EmulatedSoundCard()
    device = connected(haptuator(card, limit_v=1.0))
    generator = np.random.default_rng(1)
    for _ in range(500):
        device.write(generator.normal(0.0, 50.0, 1))
        card.advance(0.001)
    assert 6.0 * np.max(np.abs(card.played())) <= 1.0 + 1e-6
    assert device.statistics.limited_frames > 0
    assert device.statistics.clipped > 0


def test_volts_are_played_as_they_are_but_for_the_limit(connected):
    card = EmulatedSoundCard()
    device = connected(haptuator(card, limit_v=1.5))
    assert device.largest_v == 1.5
    for volts in (1.0, 9.0):
        for _ in range(500):
            device.write_volts([volts])
            card.advance(0.001)
        assert 6.0 * card.played()[-4800:] == pytest.approx(min(volts, 1.5), abs=1e-3)


def test_late_samples_are_counted_and_a_card_that_is_unplugged_or_hangs_is_lost(connected):
    card = EmulatedSoundCard()
    device = connected(haptuator(card))
    play(device, card, 0.2)
    card.underflow()
    card.advance(0.1)
    assert (device.statistics.card_underflows, device.statistics.underruns) == (1, 1)
    play(device, card, 0.2)
    assert device.statistics.underruns == 1
    card.unplug()
    check_refused(lambda: device.write([1.0]), "check its cable", DeviceLost)
    for error, words in ((MmtError, "is plugged in"), (InputError, "no default output")):
        with pytest.raises(error, match=words):  # the library lists it on until it searches again
            device.connect()
    check_refused(lambda: device.write([1.0]), "closed", DeviceLost)
    card.plug()
    device.connect()
    play(device, card, 0.2)
    assert np.max(np.abs(card.played()[-4800:])) > 0.1
    assert device.statistics.samples == 600
    card.stall()
    with pytest.raises(DeviceLost, match="asks for no more sound"):
        play(device, card, 1.0)


def test_a_card_that_takes_long_to_open_is_not_lost_before_its_first_block(connected, monkeypatch):
    card = EmulatedSoundCard()
    opened = card.OutputStream

    def open_slowly(**options):
        card.advance(0.6)
        return opened(**options)

    monkeypatch.setattr(card, "OutputStream", open_slowly)
    play(connected(haptuator(card)), card, 0.2)
    assert np.max(np.abs(card.played())) > 0.1


def test_what_cannot_be_opened_is_explained():
    card = EmulatedSoundCard()
    for changes, words in (
        ({"device": "Focusrite"}, "outputs are 0 'Emulated card'"),
        ({"channel": 3}, "has 2 output channels"),
    ):
        check_refused(haptuator(card, **changes).connect, words, InputError)
    first, second = haptuator(card), haptuator(card, card_rate_hz=8000)
    first.connect()
    check_refused(second.connect, "no other program holds it")
    first.close()
    second.set_rate(8000.0)
    with pytest.raises(InputError, match=r"8000 samples a second.*is 10000"):
        second.set_rate(10_000.0)


def test_a_missing_library_is_explained(monkeypatch):
    assert isinstance(load_device("haptuator-sound", OPTIONS), SoundHaptuator)
    monkeypatch.setitem(sys.modules, "sounddevice", None)
    with pytest.raises(InputError, match=r"\[sound\]"):
        load_sounddevice()
    found = types.ModuleType("sounddevice")
    found.__spec__ = ModuleSpec("sounddevice", None)
    monkeypatch.setitem(sys.modules, "sounddevice", found)
    whole = builtins.__import__

    def load(name, *rest):
        if name == "sounddevice":
            raise OSError("PortAudio library not found")
        return whole(name, *rest)

    monkeypatch.setattr(builtins, "__import__", load)
    with pytest.raises(MmtError, match="libportaudio2"):
        load_sounddevice()
