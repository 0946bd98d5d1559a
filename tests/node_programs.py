"""Client programs in another language: npm's stock socket.io-client under Node."""

import asyncio
import os
import shutil
import sys
from pathlib import Path

import pytest

MODULES = Path(sys.prefix) / "node" / "node_modules"
NODE = shutil.which("node")
LONGEST_S = 60.0

NEEDS_NODE = [
    pytest.mark.skipif(NODE is None, reason="Node is not installed"),
    pytest.mark.skipif(
        not (MODULES / "socket.io-msgpack-parser").is_dir(),
        reason=f"socket.io-client is not in {MODULES}: scripts/test puts it there by npm",
    ),
]
"""Marks of the modules whose tests run these programs."""


async def run_node(program: Path, *arguments: object) -> tuple[int, str, str]:
    """Run a program; return its exit code, and what it prints and complains of."""
    process = await asyncio.create_subprocess_exec(
        *(str(NODE), str(program), *map(str, arguments)),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        env={**os.environ, "NODE_PATH": str(MODULES)},
    )
    printed, complaints = await asyncio.wait_for(process.communicate(), LONGEST_S)
    return process.returncode or 0, printed.decode(), complaints.decode()
