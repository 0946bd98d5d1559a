"""The Haptuator's sketch in C++: beside the emulated board, and with the real driver."""

import math
import random
import time

import numpy as np
import pytest

pytest.importorskip("pty", reason="the sketch runs on a pseudo-terminal")

from sketches import FIRMWARE, answers_of, check_whole, compiled, needs_compiler, running
from test_haptuator_serial import play as play_tone

from mmt.core.errors import DeviceLost
from mmt.devices.drivers import load_device
from mmt.devices.haptuator.framing import (
    FULL_SCALE,
    MOST_SAMPLES,
    BoardReport,
    BoardSamples,
    Decoder,
    Reset,
    encode,
)
from mmt.testing.emulated.haptuator_board import EmulatedHaptuatorBoard

SKETCH = FIRMWARE / "haptuator" / "haptuator.ino"

HARNESS = """
#include "player.h"
#include <stdio.h>
int main() {
  haptuator::Player<8000, 1024, FADE> player;
  unsigned count, play, byte;
  while (scanf("%u %u", &count, &play) == 2) {
    for (unsigned i = 0; i < count; ++i) {
      if (scanf("%2x", &byte) != 1) return 1;
      player.receive(static_cast<uint8_t>(byte));
    }
    for (unsigned i = 0; i < play; ++i) printf("%d ", player.next());
    if (player.report_is_due()) {
      uint8_t wire[haptuator::kReportWire];
      const size_t length = player.report(wire);
      for (size_t i = 0; i < length; ++i) printf("%02x", wire[i]);
    }
    printf("\\n");
  }
}
"""


def played(program, turns):
    """Give the sketch bytes and have it play, turn by turn; return samples and reports."""
    lines = [f"{len(received)} {play} {received.hex(' ')}" for received, play in turns]
    answers = []
    for line, (_, play) in zip(answers_of(program, lines), turns, strict=True):
        words = line.split()
        answers.append(([int(word) for word in words[:play]], bytes.fromhex("".join(words[play:]))))
    return answers


def messy_turns(seed, number):
    """Return what may come in a millisecond: frames, gaps, resets, spoilt bits, garbage."""
    chance = random.Random(seed)
    sequence, turns = 0, [b"\0"]
    for _ in range(number):
        wire = b""
        for _ in range(chance.choice((0, 1, 1, 1, 2))):
            sequence = (sequence + chance.choice((1,) * 20 + (3,))) % 2**16
            count = chance.choice((8, 8, 8, 1, MOST_SAMPLES))
            extremes = (0, 1, -1, 256, FULL_SCALE, -FULL_SCALE)
            values = [chance.choice((*extremes, chance.randrange(-9999, 9999)))] * count
            wire += encode(BoardSamples(sequence, tuple(values)))
        fate = chance.random()
        if fate < 0.02:
            wire += encode(Reset())
            sequence = 0
        elif fate < 0.08 and wire:
            spoilt = bytearray(wire)
            spoilt[chance.randrange(len(wire))] ^= 1 << chance.randrange(8)
            wire = bytes(spoilt)
        elif fate < 0.12:
            wire += chance.randbytes(chance.choice((1, 5, 300))) + b"\0"
        elif fate < 0.14:
            wire = wire[: len(wire) // 2] + b"\0"
        elif fate < 0.16:
            wire += encode(BoardReport(8000, 1024, 5, 6, 7, 8))  # which is for the host
        turns.append(wire)
    return turns


@needs_compiler
def test_the_sketch_plays_and_reports_as_the_emulated_board(tmp_path, monkeypatch):
    program = compiled(HARNESS, tmp_path, "-I", str(SKETCH.parent), "-DFADE=0")
    wires = []
    board = EmulatedHaptuatorBoard()
    board.stop()  # it is stepped by hand
    monkeypatch.setattr(board, "write", wires.append)
    step = board._step
    for _ in range(5):  # up to its first report
        step(0, b"")
    turns = messy_turns(1, 4000)
    answers = played(program, [(wire, 8) for wire in turns])
    expected = []
    for number, wire in enumerate(turns, start=1):
        wires.clear()
        step(1_000_000 * number, wire)
        expected.append((board.played()[-8:], b"".join(wires)))
    assert answers == expected
    decoder = Decoder()
    reports = decoder.feed(b"\0" + b"".join(report for _, report in answers))
    assert len(reports) == len(turns) // 5
    assert any(isinstance(r, BoardReport) and r.underruns > 3 and r.lost > 3 for r in reports)


@needs_compiler
def test_a_buffer_that_runs_dry_fades_out(tmp_path):
    program = compiled(HARNESS, tmp_path, "-I", str(SKETCH.parent), "-DFADE=32")
    for end in (b"", encode(Reset())):
        turns = [
            (b"\0" + encode(BoardSamples(1, (32_000,) * 8)), 8 if not end else 4),
            (end, 40),
        ]
        (_, _), (tail, _) = played(program, turns)
        steps = np.diff([32_000, *tail])
        assert (steps <= 0).all()
        assert (steps >= -1000).all()
        assert tail[31] > 0
        assert tail[32:] == [0] * 8


@needs_compiler
@pytest.mark.parametrize(
    "macros",
    [
        ("TEENSYDUINO", "__MK66FX1M0__"),
        ("TEENSYDUINO", "__MK20DX256__"),
        ("ARDUINO_ARCH_SAM",),
        ("ARDUINO_ARCH_SAMD",),
    ],
)
def test_the_whole_sketch_is_valid(tmp_path, macros):
    check_whole(SKETCH, tmp_path, *macros)


def write_silence(device):
    for _ in range(1000):
        device.write([0.0])
        time.sleep(0.001)


@needs_compiler
def test_the_driver_plays_a_tone_on_the_sketch(tmp_path):
    with running(SKETCH, tmp_path, "__MK66FX1M0__") as sketch:
        options = {"volts_per_m_s2": 0.1, "full_scale_v": 6.0, "buffer_ms": 50.0}
        device = load_device("haptuator-serial", {**options, "port": sketch.path})
        device.connect()
        play_tone(device, lambda: device.statistics.samples >= 1000)
        statistics = device.statistics
        assert statistics.bad_messages == 0
        assert statistics.lost_frames < 50  # of a thousand: on a busy machine the sketch is late
        assert statistics.latency_ms is not None
        sketch.stop()
        with pytest.raises(DeviceLost, match="plug it in again"):
            write_silence(device)
        device.close()
    volts = (np.frombuffer(sketch.put_out(), dtype="<i2") - 2048) / 2047.0 * 6.0
    assert np.abs(volts).max() == pytest.approx(1.0, abs=0.3)
    loud = volts[np.abs(volts).cumsum() > 0][800:4000]
    levels = np.sqrt(np.mean(loud[: len(loud) // 80 * 80].reshape(-1, 80) ** 2, axis=1))
    assert np.median(levels) == pytest.approx(math.sqrt(0.5), rel=0.05)
