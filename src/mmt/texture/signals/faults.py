"""Parts of a session's signals that are no measurement: seconds by cause, and a sentence."""

from dataclasses import asdict, dataclass
from typing import Any, Final

_ACCELEROMETER: Final = {
    "held_s": "held one value for",
    "saturated_s": "was saturated for",
    "constant_s": "gave one value from the start for",
}
_JUDGED: Final = (*_ACCELEROMETER, "not_finite_s")
_FRAMES: Final = {"missing_s": "missing for", "not_finite_s": "not finite for"}


@dataclass(frozen=True)
class SignalFaults:
    """Seconds whose acceleration was no measurement, by cause, and seconds that were filled.

    ``missing_s``: frames that did not come. ``not_finite_s``: frames with a number that is not
    finite, or beyond `bridging.LARGEST_MEASUREMENT`, in a channel that is used. The other causes
    are those of `mmt.texture.signals.validity`, counted at the output of the filter. ``bridged_s``:
    filled frames, whatever the cause. ``throughout``: whether all acceleration so far was constant.
    """

    held_s: float = 0.0
    saturated_s: float = 0.0
    constant_s: float = 0.0
    not_finite_s: float = 0.0
    missing_s: float = 0.0
    bridged_s: float = 0.0
    throughout: bool = False

    def sentence(self) -> str:
        """Return the causes with their seconds, "" without a fault."""
        if self.throughout:
            parts = ["the accelerometer gave one value throughout"]
        else:
            parts = self._in_words("the accelerometer ", _ACCELEROMETER)
        parts += self._in_words("frames were ", _FRAMES)
        if self.bridged_s > 0.0:
            parts.append(f"{_seconds(self.bridged_s)} of this filled in")
        return "; ".join(parts)

    def since(self, before: "SignalFaults") -> "SignalFaults":
        """Return the faults of the acceleration since an earlier count."""
        seconds = {name: max(0.0, getattr(self, name) - getattr(before, name)) for name in _JUDGED}
        return SignalFaults(**seconds, throughout=self.throughout)

    def should_report(self, reported: "SignalFaults") -> bool:
        """Return whether the seconds of a cause have at least doubled since they were reported.

        Missing frames do not count here, as they are reported as lost. Nor does a fault that was
        reported as lasting throughout and still does.
        """
        seconds = [(getattr(self, name), getattr(reported, name)) for name in _JUDGED]
        doubled = any(now > 0.0 and now >= 2.0 * before for now, before in seconds)
        return doubled and not (self.throughout and reported.throughout)

    def as_dict(self) -> dict[str, Any]:
        """Return the seconds by cause, and the sentence, for a program."""
        table = asdict(self)
        del table["throughout"]
        return {**{name: round(value, 6) for name, value in table.items()}, "text": self.sentence()}

    def _in_words(self, whose: str, words: dict[str, str]) -> list[str]:
        """Return the words for these causes, or nothing if none has occurred."""
        values = {text: getattr(self, name) for name, text in words.items()}
        found = [f"{text} {_seconds(value)}" for text, value in values.items() if value > 0.0]
        return [whose + ", ".join(found)] if found else []


def _seconds(value: float) -> str:
    return f"{value:.3g} s" if value < 100.0 else f"{value:.0f} s"
