"""The process that serves listeners, so that none of them costs the leader's ticks anything.

It is a child of the leader, which writes msgpack maps to its standard input: ``{"model": [number,
whole, change]}``, ``{"state": bytes}`` and ``{"end": outcome}``; all but the outcome are messages
ready to be sent. It ends with that input, so that no leader leaves one behind. To standard output
it writes JSON lines: its port, and a sentence whenever a listener has come or gone.
"""

import asyncio
import json
import signal
import sys
from collections.abc import AsyncIterator
from typing import Any, Final

import msgpack

from mmt.core.errors import MmtError
from mmt.scene.sharing_tables import Sharing
from mmt.sharing.messages import LONGEST_MESSAGE
from mmt.sharing.relay import Relay
from mmt.sharing.server import SharingServer

_CHUNK: Final = 65_536


async def _input() -> AsyncIterator[dict[str, Any]]:
    """Yield what comes on standard input, until it is closed."""
    loop = asyncio.get_running_loop()
    reader = asyncio.StreamReader(limit=LONGEST_MESSAGE)
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    unpacker = msgpack.Unpacker(max_buffer_size=4 * LONGEST_MESSAGE)
    while chunk := await reader.read(_CHUNK):
        unpacker.feed(chunk)
        for message in unpacker:
            yield message


def _say(**line: object) -> None:
    print(json.dumps(line), flush=True)


async def serve(settings: Sharing, welcome: dict[str, Any]) -> None:
    """Serve listeners until standard input is closed."""
    relay = Relay()
    try:
        server = SharingServer(
            settings, relay, welcome, lambda text, count: _say(event=text, listening=count)
        )
        await server.start()
    except MmtError as error:
        _say(problem=str(error))
        return
    _say(port=server.port)
    outcome = "the leader has gone"
    async for message in _input():
        if "model" in message:
            relay.offer_model(*message["model"])
        elif "state" in message:
            relay.offer_state(message["state"])
        elif "end" in message:
            outcome = message["end"]
    relay.finish(outcome)
    await server.stop()
    _say(sent={**relay.sent, "listened_s": round(server.listened_s, 3)})


def main() -> None:
    """Run the process; the first argument is the scene's table and the welcome as JSON."""
    given = json.loads(sys.argv[1])
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the leader says when it ends
    asyncio.run(serve(Sharing.model_validate(given["sharing"]), given["welcome"]))


if __name__ == "__main__":
    main()
