"""Frames of Bota's serial protocol: their CRC, their bytes, and finding them among others."""

import random

from mmt_devices.bota.frames import SIZE, BotaFrame, FrameStream, checksum, pack_frame


def bitwise_crc(content):
    """CRC-16/X.25 as its definition has it."""
    crc = 0xFFFF
    for byte in content:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ 0x8408 if crc & 1 else crc >> 1
    return crc ^ 0xFFFF


def test_the_checksum_is_x25():
    assert checksum(b"123456789") == 0x906E  # the catalogues' check value
    generator = random.Random(3)
    for length in range(40):
        content = generator.randbytes(length)
        assert checksum(content) == bitwise_crc(content)


def test_a_frame_is_37_bytes_in_the_documented_order():
    frame = BotaFrame(5, (1.0, 2.0, 3.0, 0.5, 0.25, -1.0), 0x01020304, 30.0)
    wire = pack_frame(frame)
    assert len(wire) == SIZE
    assert wire[:3] == b"\xaa\x05\x00"
    assert wire[3:7] == b"\x00\x00\x80\x3f"
    assert wire[27:31] == b"\x04\x03\x02\x01"
    assert FrameStream().feed(wire) == [frame]


def test_frames_are_found_however_the_bytes_are_split():
    generator = random.Random(5)
    frames = [BotaFrame(0, (k, 0.0, 1.0, 0.0, 0.0, 0.0), 1000 * k, 20.0) for k in range(50)]
    content = b"App Init\r\n\xaa" + b"".join(map(pack_frame, frames))
    stream = FrameStream()
    found = []
    while content:
        length = generator.randrange(1, 60)
        found += stream.feed(content[:length])
        content = content[length:]
    assert found == frames
    assert stream.broken == 1
    stream.feed(bytes(10 * SIZE))
    assert stream.broken == 11
