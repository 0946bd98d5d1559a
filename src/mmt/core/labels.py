"""Names of figures as words, with the unit that ends them as it is written."""

from typing import Final

_UNITS: Final = {
    "nm rad": "N m/rad",
    "n s m": "N s/m",
    "mm s2": "mm/s²",
    "mm s": "mm/s",
    "m s3": "m/s³",
    "m s2": "m/s²",
    "n mm": "N/mm",
    "n s": "N/s",
    "n": "N",
    "hz": "Hz",
    "db": "dB",
    "mb": "MB",
    "mj": "mJ",
    "j": "J",
    "v": "V",
}
"""By how a name ends; the longer ending comes first. Others are written as they are: s, ms, mm."""


def label(name: object) -> str:
    """Return a key such as ``rms_m_s2``, or its words, with the unit as written: "rms m/s²"."""
    words = str(name).replace("_", " ")
    for ending, unit in _UNITS.items():
        if words.endswith(f" {ending}"):
            return words.removesuffix(ending) + unit
    return words
