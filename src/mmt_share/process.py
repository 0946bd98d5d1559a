"""The process that serves listeners, so that they do not delay the leader's ticks.

The leader starts it and writes msgpack maps to its standard input: ``{"model": [number, whole,
change]}``, ``{"state": [message, session time, ns of its making]}`` and ``{"end": outcome}``.
Models and states are encoded messages, ready to be sent. The process ends when its input is closed,
so that it does not outlive the leader. To standard output it writes JSON lines: its port, an event
when a listener joins or leaves, and once a second the figures of the listeners.

If the scene has ``[control]``, the operators' messages also go to standard output, as lines with
``control`` and ``who``. Standard input then also takes ``{"to": [operator, message]}`` and
``{"admit": operator}``: only the motion of this operator is passed on.
"""

import asyncio
import json
import signal
import sys
from collections.abc import AsyncIterator
from typing import Any, Final

import msgpack

from mmt.core.errors import MmtError
from mmt.core.output.streams import finish_output, queue_output
from mmt.core.running.process import lower_priority
from mmt.core.running.programs import handle_end_signals
from mmt_share.messages import LONGEST_MESSAGE
from mmt_share.relay import Relay
from mmt_share.server import SharingServer
from mmt_share.tables import Control, Sharing

_CHUNK: Final = 65_536
_FIGURES_PERIOD_S: Final = 1.0


async def _input() -> AsyncIterator[dict[str, Any]]:
    """Yield the messages on standard input until it is closed."""
    loop = asyncio.get_running_loop()
    reader = asyncio.StreamReader(limit=LONGEST_MESSAGE)
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    unpacker = msgpack.Unpacker(max_buffer_size=4 * LONGEST_MESSAGE)
    while chunk := await reader.read(_CHUNK):
        unpacker.feed(chunk)
        for message in unpacker:
            yield message


def _say(**line: object) -> None:
    sys.stdout.write(json.dumps(line) + "\n")


async def serve(settings: Sharing, welcome: dict[str, Any], control: Control | None = None) -> None:
    """Serve listeners until standard input is closed."""
    relay = Relay()
    try:
        server = SharingServer(
            settings, relay, welcome, lambda text, details: _say(event=text, details=details)
        )
        if control is not None:
            from mmt_share.control_messages import control_access

            server.admit_operators(control_access(control.token_file), _say)
        await server.start()
    except MmtError as error:
        _say(problem=str(error))
        return
    _say(port=server.port)
    telling = asyncio.create_task(_tell(server))
    outcome = "the leader has gone"
    async for message in _input():
        if "model" in message:
            relay.offer_model(*message["model"])
        elif "state" in message:
            relay.offer_state(*message["state"])
        elif "end" in message:
            outcome = message["end"]
        elif server.operators is not None and "to" in message:
            server.operators.send(*message["to"])
        elif server.operators is not None and "admit" in message:
            server.operators.admit_motion(message["admit"])
    telling.cancel()
    relay.finish(outcome)
    await server.stop()
    if server.operators is not None:
        _say(control="refused", who=0, count=server.operators.refused)
    _say(figures=server.figures(), listened_s=round(server.listened_s, 3))


async def _tell(server: SharingServer) -> None:
    """Write the figures once a second if they have changed."""
    told: dict[str, Any] = {}
    while True:
        await asyncio.sleep(_FIGURES_PERIOD_S)
        figures = server.figures()
        if figures != told:
            _say(figures=figures)
        told = figures


def main() -> None:
    """Run the process; its first argument is JSON with the scene's tables and the welcome."""
    given = json.loads(sys.argv[1])
    handle_end_signals(signal.SIG_IGN)  # the leader says when it ends
    lower_priority()  # so that listeners do not delay the leader's ticks
    control = None if given["control"] is None else Control.model_validate(given["control"])
    queue_output()
    try:
        asyncio.run(serve(Sharing.model_validate(given["sharing"]), given["welcome"], control))
    finally:
        finish_output()


if __name__ == "__main__":
    main()
