"""``mmt session view``: what it says where nothing can be shown."""

import socket

import aiohttp
import pytest
from frame_samples import made_frames
from recording_server import serving

from mmt.core.errors import MmtError
from mmt.session.data import RecordedSession
from mmt.session.windows import MemoryWindows
from mmt.web.viewing.recording import ViewedRecording
from mmt.web.viewing.server import RecordingServer


def recording():
    return ViewedRecording(MemoryWindows(RecordedSession(made_frames(0, 500))))


async def test_a_port_that_is_taken():
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(MmtError, match=f"port {port} .*: set --port to"):
            await RecordingServer(recording(), port).run(lambda _: None)


async def test_what_is_asked_wrongly_is_refused():
    async with serving(recording()) as url, aiohttp.ClientSession() as client:

        async def status(path, **headers):
            async with client.get(url + path, headers=headers) as answer:
                return answer.status

        assert await status("moment?time_s=0.2") == 200
        assert await status("moment?time_s=1e300") == 200  # which is the end
        assert await status("moment?time_s=nan") == 400
        assert await status("moment") == 400
        assert await status("model?number=1e999") == 400
        assert await status("model?number=-1") == 404
        assert await status("nothing.js") == 404
        # another site's page, and another site's name for this machine
        assert await status("opening", Origin="http://elsewhere.example") == 403
        assert await status("opening", Host="elsewhere.example") == 403
