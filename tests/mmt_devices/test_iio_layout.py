"""How a scan lies in the buffer of industrial I/O, against the kernel's documentation."""

import random
import struct

from mmt_devices.iio.layout import Layout, parse_element


def test_a_scan_lies_as_the_kernels_documentation_has_it():
    kinds = {"a": "be:u16/16>>0", "b": "be:u32/32>>0", "c": "be:u32/32>>0", "d": "be:u64/64>>0"}
    elements = [parse_element(name, str(i), kind) for i, (name, kind) in enumerate(kinds.items())]
    layout = Layout(elements, "abcd")
    assert layout.size == 24
    scan = struct.pack(">HxxIIxxxxQ", 1, 2, 3, 4)
    assert list(layout.decode(scan + scan)) == [(1, 2, 3, 4)] * 2
    layout = Layout([elements[0], elements[3]], "da")
    assert layout.size == 16
    assert list(layout.decode(struct.pack(">H6xQ", 1, 4))) == [(4, 1)]
    assert Layout(elements[1:2] + elements[:1], "a").size == 8  # padded to its largest


def test_shifted_and_signed_values_are_decoded():
    element = parse_element("in_accel_y", "1", "le:s12/16>>4")
    assert element.bounds == (-2048, 2047)
    layout = Layout([element], [element.name])
    for value in (-2048, -1, 0, 1, 2047):
        word = (value % 4096) << 4 | 0xF  # what is beside the bits is none of the value
        assert list(layout.decode(word.to_bytes(2, "little"))) == [(value,)]
    unsigned = parse_element("in_accel_y", "1", "be:u20/32>>4")
    assert unsigned.bounds == (0, 2**20 - 1)
    random.seed(1)
    for value in (0, 1, 2**19, 2**20 - 1):
        word = value << 4 | random.randrange(16) | random.randrange(256) << 24
        assert list(Layout([unsigned], ["in_accel_y"]).decode(word.to_bytes(4, "big"))) == [
            (value,)
        ]
