"""The accelerometer's frames: their time axis, and the sketch in C++ that sends them."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_reading import read_some
from sketches import FIRMWARE, answers_of, check_whole, compiled, needs_compiler, running

from mmt.devices.adxl335.framing import (
    MOST_SAMPLES,
    BoardFrame,
    Timeline,
    encode_frame,
)
from mmt.devices.adxl335.gravity import GRAVITY_M_S2
from mmt.devices.drivers import load_device

SKETCH = FIRMWARE / "adxl335" / "adxl335.ino"


def one(sequence, time_us, n=1):
    return BoardFrame(sequence % 2**32, time_us % 2**32, ((1, 2, 3),) * n)


@given(
    st.integers(1, 4000),
    st.lists(st.tuples(st.integers(0, 50) | st.just(2**20), st.integers(1, 32)), max_size=30),
)
def test_every_sample_has_its_own_time_and_lost_ones_are_counted(period_us, steps):
    """Also where a counter wraps."""
    timeline, start, number, lost = Timeline(Counter()), 2**32 - 100, 0, 0
    timeline.place(one(start, start))
    for step, n in steps:
        before, number = number, number + step
        samples = [(k % 2**16, 1, 2) for k in range(number - n + 1, number + 1)]
        last = one(start + number, start + period_us * number)
        placed = timeline.place(last._replace(samples=tuple(samples)))
        assert placed == tuple(
            ((start + period_us * k) * 1000, (k % 2**16, 1, 2))
            for k in range(max(before, number - n) + 1, number + 1)
        )
        lost += max(0, step - n)
    assert timeline.faults["lost samples"] == lost
    assert timeline.faults["repeated frames"] == [step for step, _ in steps].count(0)
    assert not timeline.faults["restarts"]


def test_a_repeated_frame_is_left_out_and_after_a_restart_the_boards_own_time_holds():
    timeline, samples = Timeline(Counter()), ((7, 8, 9), (1, 2, 3))
    begun = timeline.place(BoardFrame(500_000, 10**9, samples))
    assert begun == ((10**12, (1, 2, 3)),)
    assert timeline.place(one(500_000, 10**9)) == ()
    ((restarted, sample),) = timeline.place(BoardFrame(500_000 + 2**20 + 1, 1000, samples))
    assert (restarted, sample) == (10**6, (1, 2, 3))
    (*_, (following, _)) = timeline.place(one(500_000 + 2**20 + 2, 2000, 2))
    assert following - restarted == 1_000_000
    assert timeline.place(one(1, 1000))[0][0] == 10**6
    assert timeline.faults == {"repeated frames": 1, "restarts": 2}


HARNESS = """
#include "framing.h"
#include <stdio.h>
int main() {
  unsigned long sequence, micros, n;
  while (scanf("%lu %lu %lu", &sequence, &micros, &n) == 3) {
    framing::Sample samples[40];
    for (unsigned long i = 0; i < n; ++i) {
      unsigned x, y, z;
      if (scanf("%u %u %u", &x, &y, &z) != 3) return 1;
      samples[i].x = x; samples[i].y = y; samples[i].z = z;
    }
    uint8_t wire[framing::kWireBytes];
    size_t length = framing::encode(sequence, micros, samples, n, wire);
    for (size_t i = 0; i < length; ++i) printf("%02x", wire[i]);
    printf("\\n");
  }
}
"""


@needs_compiler
def test_the_sketch_sends_what_python_reads(tmp_path):
    program = compiled(HARNESS, tmp_path, "-I", str(SKETCH.parent))
    sent = [
        BoardFrame(0, 0, ((0, 0, 0),)),
        BoardFrame(2**32 - 1, 2**32 - 1, ((65535, 65535, 65535),) * MOST_SAMPLES),
        BoardFrame(1000, 2_000_000, ((2048, 2050, 2458),)),
        *(
            BoardFrame(256 * k, 65536 * k, tuple((k, 256 * i, 65535 - k) for i in range(k)))
            for k in range(1, MOST_SAMPLES + 1)
        ),
    ]
    lines = [
        f"{f.sequence} {f.time_us} {len(f.samples)} "
        + " ".join(str(value) for sample in f.samples for value in sample)
        for f in sent
    ]
    wires = [bytes.fromhex(line) for line in answers_of(program, lines)]
    assert wires == [encode_frame(frame) for frame in sent]


@needs_compiler
@pytest.mark.parametrize("board", ["TEENSYDUINO", "ARDUINO_SAMD_ZERO"])
def test_the_whole_sketch_is_valid(tmp_path, board):
    check_whole(SKETCH, tmp_path, board)


@needs_compiler
def test_the_driver_reads_the_sketch(tmp_path, monkeypatch):
    pytest.importorskip("pty", reason="the sketch runs on a pseudo-terminal")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    reading = "2048 + (pin == A2 ? 410 : 0) + (micros() >> 9) % 2"  # 1 g along z, and a tremor
    with running(SKETCH, tmp_path, "TEENSYDUINO", reading) as sketch:
        sensor = load_device("adxl335-serial", {"port": sketch.path, "bandwidth_hz": 500})
        sensor.connect()
        readings = read_some(sensor, 400)
        sensor.close()
    x, y, z = np.median([reading.value for reading in readings], axis=0)
    assert (x, y, z) == pytest.approx((0.0, 0.0, GRAVITY_M_S2), abs=0.05)
    periods = len(readings) - 1 + sensor.faults.get("lost samples", 0)  # which it was too late for
    span_ns = readings[-1].time_ns - readings[0].time_ns
    assert span_ns / periods == pytest.approx(500_000, rel=0.1)
    assert not {"bad checksums", "bad frames", "other versions"} & set(sensor.faults)
