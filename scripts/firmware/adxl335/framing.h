// Frames of accelerometer samples: COBS, ended by 0x00, with a CRC-16.
// The format is described in docs/reference/accelerometer-framing.md. No Arduino header is needed,
// so that this file can be compiled and tested on any machine.

#pragma once

#include <stddef.h>
#include <stdint.h>

namespace framing {

const uint8_t kVersion = 1;
const size_t kMostSamples = 32;
const size_t kHeadBytes = 9;     // version, sequence, microseconds
const size_t kSampleBytes = 6;   // x, y, z
const size_t kPlainBytes = kHeadBytes + kMostSamples * kSampleBytes + 2;
const size_t kWireBytes = kPlainBytes + 2;  // the first COBS code and the final zero

struct Sample {
  uint16_t x, y, z;
};

// CRC-16, polynomial 0x1021, begun with 0xFFFF, not reflected; "123456789" gives 0x29B1.
inline uint16_t crc16(const uint8_t *bytes, size_t count) {
  uint16_t crc = 0xFFFF;
  for (size_t i = 0; i < count; ++i) {
    crc ^= static_cast<uint16_t>(bytes[i]) << 8;
    for (int bit = 0; bit < 8; ++bit) {
      crc = (crc & 0x8000) ? static_cast<uint16_t>((crc << 1) ^ 0x1021)
                           : static_cast<uint16_t>(crc << 1);
    }
  }
  return crc;
}

inline size_t put16(uint8_t *to, uint16_t value) {
  to[0] = static_cast<uint8_t>(value);
  to[1] = static_cast<uint8_t>(value >> 8);
  return 2;
}

inline size_t put32(uint8_t *to, uint32_t value) {
  put16(to, static_cast<uint16_t>(value));
  put16(to + 2, static_cast<uint16_t>(value >> 16));
  return 4;
}

// COBS for at most 253 bytes, then the final zero; returns the number of bytes written.
inline size_t stuff(const uint8_t *plain, size_t count, uint8_t *wire) {
  size_t code_at = 0;
  size_t at = 1;
  for (size_t i = 0; i < count; ++i) {
    if (plain[i] == 0) {
      wire[code_at] = static_cast<uint8_t>(at - code_at);
      code_at = at++;
    } else {
      wire[at++] = plain[i];
    }
  }
  wire[code_at] = static_cast<uint8_t>(at - code_at);
  wire[at++] = 0;
  return at;
}

// Writes a frame into wire (at least kWireBytes) and returns its length, 0 where count is not
// 1 to kMostSamples. sequence and microseconds are those of the last sample.
inline size_t encode(uint32_t sequence, uint32_t microseconds, const Sample *samples, size_t count,
                     uint8_t *wire) {
  if (count < 1 || count > kMostSamples) return 0;
  uint8_t plain[kPlainBytes];
  size_t at = 0;
  plain[at++] = kVersion;
  at += put32(plain + at, sequence);
  at += put32(plain + at, microseconds);
  for (size_t i = 0; i < count; ++i) {
    at += put16(plain + at, samples[i].x);
    at += put16(plain + at, samples[i].y);
    at += put16(plain + at, samples[i].z);
  }
  at += put16(plain + at, crc16(plain, at));
  return stuff(plain, at, wire);
}

}  // namespace framing
