"""Writes what a recipient of LSL streams got as LabRecorder does, see github.com/sccn/xdf."""

import struct
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np


class Received(NamedTuple):
    """A stream: its description as LSL gives it, samples and their stamps."""

    xml: str
    samples: Sequence[Any]
    stamps_s: Sequence[float]
    clock_offset_s: float = 0.0


def write_xdf(path, streams):
    """Write streams of float32 or strings."""
    parts = [b"XDF:", _chunk(1, b'<?xml version="1.0"?><info><version>1.0</version></info>')]
    for number, stream in enumerate(streams, start=1):
        name = struct.pack("<I", number)
        parts.append(_chunk(2, name + stream.xml.encode()))
        parts.append(
            _chunk(4, name + struct.pack("<dd", stream.stamps_s[0], stream.clock_offset_s))
        )
        content = [name, b"\x04", struct.pack("<I", len(stream.samples))]
        for sample, stamp_s in zip(stream.samples, stream.stamps_s, strict=True):
            content += [b"\x08", struct.pack("<d", stamp_s), _packed(sample)]
        parts.append(_chunk(3, b"".join(content)))
        parts.append(_chunk(6, name + b'<?xml version="1.0"?><info></info>'))
    path.write_bytes(b"".join(parts))


def _packed(sample):
    if not isinstance(sample[0], str):
        return np.asarray(sample, "<f4").tobytes()
    texts = [text.encode() for text in sample]
    return b"".join(b"\x04" + struct.pack("<I", len(text)) + text for text in texts)


def _chunk(tag, content):
    return b"\x04" + struct.pack("<IH", len(content) + 2, tag) + content
