"""Recorded sessions: write, read, replay, import, export, recover.

``mmt.session.recording`` records while a session runs and ``mmt.session.replay`` sends a
recorded one again; both are imported by the services that need them.
"""

from mmt.session.reading import import_session, read_session
from mmt.session.recorded import OutputBlock, RecordedSession
from mmt.session.writing import export_session, write_session

__all__ = [
    "OutputBlock",
    "RecordedSession",
    "export_session",
    "import_session",
    "read_session",
    "write_session",
]
