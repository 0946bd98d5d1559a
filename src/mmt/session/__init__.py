"""Recorded sessions: write, read, replay, import, export and recover them.

`mmt.session.recorder` records while a session runs and `mmt.session.replay` sends a recorded
one again; the services that need them import them.
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
