// Samples an ADXL335 at an even rate and sends frames over USB serial.
//
// For a Teensy 3.2, 3.6, 4.0 or 4.1, and for Arduino boards with a 12-bit converter and USB of
// their own (Zero, Due, MKR). Wiring: the sensor's supply and the converter's reference to 3.3 V,
// X, Y, Z to A0, A1, A2, ground to ground. The board's capacitors set the bandwidth (5 uF / C Hz):
// replace the 0.1 uF that breakout boards ship with by 0.01 uF for 500 Hz.
//
// The driver's defaults go with it: resolution_bits = 12, reference_v = 3.3, baud_rate = 500000.

#include <Arduino.h>

#include "framing.h"

const uint32_t kBaudRate = 500000;      // boards with USB of their own ignore it
const uint32_t kPeriodMicros = 500;     // 2 kHz
const size_t kSamplesPerFrame = 1;      // more of them save bytes and cost delay
const uint8_t kPins[3] = {A0, A1, A2};

static uint32_t sequence = 0;
static uint32_t due = 0;
static size_t gathered = 0;
static framing::Sample samples[kSamplesPerFrame];
static uint8_t wire[framing::kWireBytes];

void setup() {
  Serial.begin(kBaudRate);
  analogReadResolution(12);
#if defined(TEENSYDUINO)
  analogReadAveraging(4);
#endif
  due = micros();
}

void loop() {
  // A signed difference of unsigned times stays right where the counter wraps.
  if (static_cast<int32_t>(micros() - due) < 0) return;
  const uint32_t now = micros();
  due += kPeriodMicros;
  if (static_cast<int32_t>(now - due) >= 0) {
    // Held up for more than a period: number what was missed, so that the host sees the gap.
    const uint32_t missed = (now - due) / kPeriodMicros + 1;
    sequence += missed;
    due += missed * kPeriodMicros;
    gathered = 0;  // a frame's samples lie evenly, so none may span a gap
  }

  framing::Sample &sample = samples[gathered++];
  sample.x = static_cast<uint16_t>(analogRead(kPins[0]));
  sample.y = static_cast<uint16_t>(analogRead(kPins[1]));
  sample.z = static_cast<uint16_t>(analogRead(kPins[2]));
  ++sequence;
  if (gathered < kSamplesPerFrame) return;

  gathered = 0;
  const size_t length = framing::encode(sequence, now, samples, kSamplesPerFrame, wire);
  // Never wait for a host that does not read: drop the frame, whose number will be missing.
  if (Serial.availableForWrite() >= static_cast<int>(length)) Serial.write(wire, length);
}
