// Plays what the driver haptuator-serial sends: samples over USB serial, through a buffer, at a
// converter (DAC).
//
// For boards with a converter: Teensy 3.2, 3.5 or 3.6 (12 bits, at A14 or A21), Arduino Due (DAC0)
// and Arduino Zero and MKR (10 bits, at A0). The pin gives half the reference at rest and must not
// drive an actuator by itself: it goes through a capacitor to an amplifier.
//
// The driver's defaults go with it: board_rate_hz = 8000, baud_rate = 1000000.

#include <Arduino.h>

#include "player.h"

#if defined(__MK64FX512__) || defined(__MK66FX1M0__)  // Teensy 3.5, 3.6
const uint8_t kPin = A21;
#elif defined(__MK20DX256__)  // Teensy 3.2
const uint8_t kPin = A14;
#elif defined(ARDUINO_ARCH_SAM)  // Due
const uint8_t kPin = DAC0;
#elif defined(ARDUINO_ARCH_SAMD)  // Zero, MKR
const uint8_t kPin = A0;
#else
#error "the sketch knows no converter of this board: name its pin here"
#endif

const uint32_t kBaudRate = 1000000;  // boards with USB of their own ignore it
const uint32_t kPeriodMicros = 125;  // 8 kHz
const uint32_t kRateHz = 1000000 / kPeriodMicros;
const uint16_t kCapacity = 1024;     // samples, 128 ms
const uint16_t kFadeSamples = 32;    // 4 ms
const int kBits = 12;

static auto &port = Serial;  // Due and Zero have their USB of their own at SerialUSB
static haptuator::Player<kRateHz, kCapacity, kFadeSamples> player;
static uint32_t due = 0;

static void put_out(int16_t sample) {
  const int32_t middle = 1 << (kBits - 1);
  analogWrite(kPin, static_cast<int>(middle + static_cast<int32_t>(sample) * (middle - 1) / 32767));
}

static void report() {
  uint8_t wire[haptuator::kReportWire];
  const size_t length = player.report(wire);
  // Never wait for a host that does not read: the next report says more.
  if (port.availableForWrite() < static_cast<int>(length)) return;
  port.write(wire, length);
#if defined(TEENSYDUINO)
  port.send_now();  // else it waits for more
#endif
}

void setup() {
  port.begin(kBaudRate);
  analogWriteResolution(kBits);
  put_out(0);
  due = micros();
}

// A signed difference of unsigned times stays right where the counter wraps.
static bool is_due() { return static_cast<int32_t>(micros() - due) >= 0; }

void loop() {
  // Periods that were missed are made up for at once, so that the rate stays that of the clock.
  while (is_due()) {
    due += kPeriodMicros;
    put_out(player.next());
  }
  while (!is_due() && port.available() > 0) player.receive(static_cast<uint8_t>(port.read()));
  if (player.report_is_due()) report();
}
