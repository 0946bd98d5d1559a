// The host's frames into samples for a converter, and the board's reports.
// The format is described in docs/reference/haptuator-framing.md. No Arduino header is needed, so
// that this file can be compiled and tested on any machine.

#pragma once

#include <stddef.h>
#include <stdint.h>

namespace haptuator {

const uint8_t kVersion = 1;
const uint8_t kSamples = 1;
const uint8_t kReset = 2;
const uint8_t kReport = 3;

const size_t kMostSamples = 120;
const size_t kHeadBytes = 2;      // version, kind
const size_t kCheckBytes = 2;     // CRC-16
const size_t kMostStuffed = 254;  // without the final zero
const size_t kMostPlain = kMostStuffed - 1;
const size_t kReportBytes = kHeadBytes + 14 + kCheckBytes;
const size_t kReportWire = kReportBytes + 2;  // the first COBS code and the final zero
const uint32_t kReportsHz = 200;

// One byte more of a CRC-16: polynomial 0x1021, begun with 0xFFFF, not reflected.
inline uint16_t crc16(uint16_t crc, uint8_t byte) {
  crc ^= static_cast<uint16_t>(byte) << 8;
  for (int bit = 0; bit < 8; ++bit) {
    crc = (crc & 0x8000) ? static_cast<uint16_t>((crc << 1) ^ 0x1021)
                         : static_cast<uint16_t>(crc << 1);
  }
  return crc;
}

inline uint16_t get16(const uint8_t *from) {
  return static_cast<uint16_t>(from[0] | from[1] << 8);
}

inline size_t put16(uint8_t *to, uint16_t value) {
  to[0] = static_cast<uint8_t>(value);
  to[1] = static_cast<uint8_t>(value >> 8);
  return 2;
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

// Undoes COBS and checks the CRC byte by byte, so that no byte takes long.
class Unstuffer {
 public:
  // Takes a byte; returns whether it ended a frame that is whole and sound.
  bool take(uint8_t byte) {
    if (byte == 0) {
      const bool whole = !skipping_ && left_ == 0 && count_ >= kHeadBytes + kCheckBytes &&
                         crc_ == get16(plain_ + count_ - kCheckBytes);
      length_ = whole ? count_ - kCheckBytes : 0;
      begin();
      return whole;
    }
    if (skipping_) return false;
    if (++stuffed_ > kMostStuffed) {
      skipping_ = true;  // until the next zero
    } else if (left_ > 0) {
      --left_;
      push(byte);
    } else {
      if (stuffed_ > 1) push(0);
      left_ = static_cast<uint8_t>(byte - 1);
    }
    return false;
  }

  // The frame that ended, without its CRC; until the next byte is taken.
  const uint8_t *frame() const { return plain_; }
  size_t length() const { return length_; }

 private:
  void begin() {
    skipping_ = false;
    left_ = 0;
    stuffed_ = count_ = 0;
    crc_ = 0xFFFF;
  }

  void push(uint8_t byte) {
    plain_[count_++] = byte;
    if (count_ > kCheckBytes) crc_ = crc16(crc_, plain_[count_ - 1 - kCheckBytes]);
  }

  uint8_t plain_[kMostPlain];
  size_t count_ = 0;
  size_t length_ = 0;
  size_t stuffed_ = 0;
  uint16_t crc_ = 0xFFFF;
  uint8_t left_ = 0;      // bytes of the block that are still to come
  bool skipping_ = true;  // what comes before the first zero began earlier
};

// Buffers samples, hands them out one by one, and says how it goes.
// After an underrun or a reset the last sample fades out within FadeSamples.
template <uint32_t RateHz, uint16_t Capacity, uint16_t FadeSamples>
class Player {
 public:
  // Takes a byte from the host.
  void receive(uint8_t byte) {
    if (!unstuffer_.take(byte)) return;
    const uint8_t *frame = unstuffer_.frame();
    const size_t length = unstuffer_.length();
    if (frame[0] != kVersion) return;
    const uint8_t *body = frame + kHeadBytes;
    const size_t count = length < kHeadBytes + 4 ? 0 : (length - kHeadBytes - 2) / 2;
    if (frame[1] == kReset && length == kHeadBytes) {
      reset();
    } else if (frame[1] == kSamples && 1 <= count && count <= kMostSamples && length % 2 == 0) {
      accept(get16(body), body + 2, static_cast<uint16_t>(count));
    }
  }

  // Returns the sample of this period, full scale is +-32767.
  int16_t next() {
    ++periods_;
    if (fill_ > 0) {
      last_ = buffer_[first_];
      first_ = static_cast<uint16_t>((first_ + 1) % Capacity);
      --fill_;
      fade_ = FadeSamples;
      return last_;
    }
    if (running_) {
      running_ = false;
      ++underruns_;
    }
    if (fade_ == 0) return 0;
    return static_cast<int16_t>(static_cast<int32_t>(last_) * fade_-- / (FadeSamples + 1));
  }

  // Returns whether it is time for a report, once each time.
  bool report_is_due() {
    if (periods_ < RateHz / kReportsHz) return false;
    periods_ = 0;
    return true;
  }

  // Writes a report into wire (at least kReportWire) and returns its length.
  size_t report(uint8_t *wire) const {
    uint8_t plain[kReportBytes];
    size_t at = 0;
    plain[at++] = kVersion;
    plain[at++] = kReport;
    at += put16(plain + at, static_cast<uint16_t>(RateHz & 0xFFFF));
    at += put16(plain + at, static_cast<uint16_t>(RateHz >> 16));
    at += put16(plain + at, Capacity);
    at += put16(plain + at, fill_);
    at += put16(plain + at, sequence_);
    at += put16(plain + at, underruns_);
    at += put16(plain + at, lost_);
    uint16_t crc = 0xFFFF;
    for (size_t i = 0; i < at; ++i) crc = crc16(crc, plain[i]);
    at += put16(plain + at, crc);
    return stuff(plain, at, wire);
  }

 private:
  void reset() {
    first_ = fill_ = sequence_ = underruns_ = lost_ = 0;
    running_ = false;
  }

  void accept(uint16_t sequence, const uint8_t *values, uint16_t count) {
    lost_ = static_cast<uint16_t>(lost_ + static_cast<uint16_t>(sequence - sequence_ - 1));
    sequence_ = sequence;
    if (fill_ + count > Capacity) {
      ++lost_;
      return;
    }
    for (uint16_t i = 0; i < count; ++i, values += 2) {
      buffer_[(first_ + fill_++) % Capacity] = static_cast<int16_t>(get16(values));
    }
    running_ = true;
  }

  Unstuffer unstuffer_;
  int16_t buffer_[Capacity];
  uint16_t first_ = 0;
  uint16_t fill_ = 0;
  uint16_t sequence_ = 0;
  uint16_t underruns_ = 0;
  uint16_t lost_ = 0;
  uint32_t periods_ = 0;
  int16_t last_ = 0;
  uint16_t fade_ = 0;
  bool running_ = false;
};

}  // namespace haptuator
