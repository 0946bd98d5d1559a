"""Turn the keys of figures into words, with the unit at their end in its usual spelling."""

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
"""Units by the ending of a key, longer endings first. Other units, such as mm, stay as they are."""


def label(name: object) -> str:
    """Return a key such as ``rms_m_s2``, or its words, as a label such as "rms m/s²"."""
    words = str(name).replace("_", " ")
    for ending, unit in _UNITS.items():
        if words.endswith(f" {ending}"):
            return words.removesuffix(ending) + unit
    return words
