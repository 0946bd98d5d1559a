"""The monitor's messages as its page reads them."""

import asyncio
import json
import struct

import numpy as np


def unpack(message):
    """Return the header of a message; "arrays" holds the arrays by name."""
    (length,) = struct.unpack_from("<I", message)
    header = json.loads(message[4 : 4 + length])
    offset, arrays = 4 + length, {}
    assert offset % 4 == 0
    for name, shape in header["arrays"]:
        count = int(np.prod(shape))
        arrays[name] = np.frombuffer(message, "<f4", count, offset).reshape(shape)
        offset += 4 * count
    assert offset == len(message)
    return {**header, "arrays": arrays}


async def until(socket, kind):
    """Return the next message of a kind."""
    async with asyncio.timeout(60):
        while True:
            message = unpack(await socket.receive_bytes())
            if message["kind"] == kind:
                return message
