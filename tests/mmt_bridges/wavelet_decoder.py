"""A decoder of wavelet bands of MPEG haptics, written apart from the encoder, for its tests.

Plain recursion and lists, after Said and Pearlman (1996), Witten, Neal and Cleary (1987) and
ISO/IEC 23090-31; the wavelets are rebuilt from the two filters as one linear map.
"""

import json
from functools import cache

import numpy as np

ALPHABET = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/"

LOW = [0.037828455506995, -0.023849465019380, -0.110624404418423, 0.377402855612654]
LOW = [*LOW, 0.852698679009404, *LOW[::-1]]
HIGH = [-0.064538882628938, 0.040689417609559, 0.418092273222212]
HIGH = [*HIGH, -0.788485616405665, *HIGH[::-1]]


class Bits:
    """Reads symbols of an arithmetic code: ten bits, a probability for each of seven contexts."""

    def __init__(self, stream):
        self.bits = "".join(f"{ALPHABET.index(letter):06b}" for letter in stream)
        self.at = 10
        self.value = int(self.bits[:10].ljust(10, "0"), 2)
        self.lower, self.upper = 0, 1024
        self.zeros, self.all = [8] * 7, [16] * 7

    def read(self, context):
        """Return the next symbol of a context."""
        width = self.upper - self.lower
        share = int(self.zeros[context] / self.all[context] * 1024 + 0.5)
        part = min(max(width * share // 1024, 1), width - 1)
        symbol = int(self.value - self.lower >= part)
        if symbol:
            self.lower += part
        else:
            self.upper = self.lower + part
        self.zeros[context] += 1 - symbol
        self.all[context] += 1
        while True:
            if self.upper <= 512:
                offset = 0
            elif self.lower >= 512:
                offset = 512
            elif self.lower >= 256 and self.upper <= 768:
                offset = 256
            else:
                return symbol
            follows = int(self.bits[self.at : self.at + 1] or "0")
            self.at += 1
            self.lower = 2 * (self.lower - offset)
            self.upper = 2 * (self.upper - offset)
            self.value = 2 * (self.value - offset) + follows

    def number(self, count):
        """Return a number of the header, its lowest bit first."""
        return sum(self.read(0) << bit for bit in range(count))


def coefficients_of(stream, count):
    """Return the wavelet coefficients of a block of `count` samples."""
    bits, values = Bits(stream), [0] * count
    planes = bits.number(4)
    scale = bits.number(1)
    scale = bits.number(7) / 128 if not scale else 1 + bits.number(7) / 8
    pixels, found = list(range(8)), list[int]()
    sets = [(place, "A") for place in range(4, 8)]

    def test(place, context, plane, missed):
        if bits.read(context):
            values[place] = 1 << plane if bits.read(1) else -(1 << plane)
            found.append(place)
        else:
            missed.append(place)

    for plane in range(planes, -1, -1):
        before, missed = list(found), list[int]()
        for place in pixels:
            test(place, 2, plane, missed)
        pixels, queue, sets = missed, sets, []
        while queue:
            place, kind = queue.pop(0)
            if not bits.read(3 if kind == "A" else 5):
                sets.append((place, kind))
            elif kind == "A":
                for child in (2 * place, 2 * place + 1):
                    test(child, 4, plane, pixels)
                if 4 * place < count:
                    queue.append((place, "B"))
            else:
                queue += [(2 * place, "A"), (2 * place + 1, "A")]
        for place in before:
            if bits.read(6):
                values[place] += (1 if values[place] > 0 else -1) << plane
    return np.array(values) * scale / 2.0**planes


@cache
def analysis(count):
    """Return the matrix that makes coefficients of a block of samples, mirrored at its ends."""
    whole = np.eye(count)
    width = count
    while width > 4:
        step = np.eye(count)
        step[:width, :width] = 0.0
        for row in range(width):
            taps = LOW if row % 2 == 0 else HIGH
            target = row // 2 if row % 2 == 0 else width // 2 + row // 2
            for offset, tap in enumerate(taps, -(len(taps) // 2)):
                column = abs(row + offset)
                column = 2 * (width - 1) - column if column >= width else column
                step[target, column] += tap
        whole = step @ whole
        width //= 2
    return whole


def decode(path):
    """Return the waveform of a file with one channel of one wavelet band, and the document."""
    document = json.loads(path.read_text())
    channel = document["perceptions"][0]["channels"][0]
    (band,) = channel["bands"]
    count = band["block_length"] * channel["frequency_sampling"] // document["timescale"]
    back = np.linalg.inv(analysis(count))
    blocks = [back @ coefficients_of(each["wavelet_stream"], count) for each in band["effects"]]
    return np.concatenate(blocks)[: channel["sample_count"]], document
