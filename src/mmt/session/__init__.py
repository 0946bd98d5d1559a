"""Recorded sessions: write, read, replay, import, export and recover them.

`mmt.session.recorder` records a running session and `mmt.session.replay` sends a recorded one
again; neither is imported here.
"""

from mmt.session.data import OutputBlock, RecordedSession
from mmt.session.files import export_session, import_session, read_session, write_session

__all__ = [
    "OutputBlock",
    "RecordedSession",
    "export_session",
    "import_session",
    "read_session",
    "write_session",
]
