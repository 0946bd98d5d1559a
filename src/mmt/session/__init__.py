"""Recorded sessions: write, read, replay, import, export and recover them.

The names here are those of two modules, which are imported when a name is first used.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
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


if not TYPE_CHECKING:  # type checkers would take any name for an attribute of the module

    def __getattr__(name: str) -> Any:
        if name not in __all__:
            message = f"module {__name__!r} has no attribute {name!r}"
            raise AttributeError(message)
        home = "files" if name.endswith("_session") else "data"
        return getattr(importlib.import_module(f"{__name__}.{home}"), name)
