"""Consistent overhead byte stuffing of short frames: none of the bytes is zero then.

S. Cheshire, M. Baker: *Consistent Overhead Byte Stuffing*, IEEE/ACM Trans. Networking 7(2), 1999.
"""


def stuff(plain: bytes) -> bytes:
    """Return bytes COBS-encoded: none of them is zero.

    Raises
    ------
    ValueError
        More than 253 bytes, which would need more than one byte beside them.
    """
    if len(plain) > 253:
        raise ValueError(f"{len(plain)} bytes are too long for a frame")
    blocks = plain.split(b"\0")
    return b"".join(bytes((len(block) + 1,)) + block for block in blocks)


def unstuff(stuffed: bytes) -> bytes | None:
    """Return COBS-encoded bytes decoded, None where they are none."""
    plain = bytearray(stuffed)
    at, end = 0, len(plain)
    while at < end:
        following = at + plain[at]
        if following == at:
            return None
        plain[at] = 0  # where a block ends; the first one has none before it
        at = following
    return bytes(plain[1:]) if at == end else None
