"""Texts of reports: numbers for people, a dash if there is none, and how each score is defined."""

from collections.abc import Mapping
from typing import Final

DEFINITIONS: Final[Mapping[str, str]] = {
    "gfc": (
        "Goodness-of-fit criterion (Awan et al., eq. 2) between the Welch amplitude spectra of "
        "the held-out segments and of vibration synthesized at their mean speed and force, "
        "for as many samples, by the model rebuilt without them; Hann windows of 64 ms, "
        "half overlapping; the mean over the segments and four realisations each."
    ),
    "gfc_ceiling": (
        "The same criterion between two realisations of the model itself: what a perfect "
        "model would score on segments of this length."
    ),
    "truth_gfc": (
        "The same criterion between what those Welch spectra are on average for the leader's "
        "model and for the known texture, both computed from the exact spectra; the mean over "
        "the plane. Its ceiling is 1."
    ),
    "truth_log_spectral_db": (
        "Root mean square from 10 Hz to half the rate of the acceleration, in steps of 2 Hz, of "
        "the ratio of the exact densities in dB; the mean over the plane."
    ),
    "power_error_db": (
        "Root mean square of 10 log10 (power of the model / power of the reference), both as far "
        "as a vibration is felt, up to 1 kHz or half the rate of the acceleration, where powers "
        "below 0.0001 (m/s2)^2, which nobody feels, count as that. Basis "
        "'truth': against the known texture, over up to 400 moments of the strokes that were made "
        "with at least the least speed and force, evenly spread over the session. Basis "
        "'held-out': over the held-out segments, against their mean square."
    ),
    "within_jnd": (
        "Share of the same strokes whose power error is at most 1.36 dB, the just noticeable "
        "difference of 17 % in amplitude."
    ),
    "plane_power_error_db": (
        "As power_error_db over the whole plane, and so is plane_within_jnd: the middles of "
        "12 x 12 equal cells from 10 to 300 mm/s and 0.1 to 3 N. Only with basis 'truth'."
    ),
    "beside": (
        "The other method's model of the same session, and the error of its level as above; with "
        "basis 'held-out' it is built without the held-out segments too."
    ),
    "update_ms": (
        "Time of the leader's update before the step: filtering, segmenting and fitting its "
        "frames, building the model until it is ready to render, and judging it, on the machine "
        "that evaluates, one after the other."
    ),
    "bands": (
        "Root mean square in dB, over the plane or the held-out segments, of the error of the "
        "power in each band, at the stop criterion or at the end. Bands have edges of equal ratio, "
        "0.63 octaves, from 10 Hz to half the rate of the acceleration."
    ),
    "by_heading": (
        "GFC as truth_gfc, log-spectral distance (as truth_log_spectral_db, mean over the "
        "strokes), power error and share within one JND "
        "in sectors of 30 degrees of the stroke's heading, on textures that depend on it: "
        "6 x 6 cells of the plane at 24 headings, over which the other scores over the plane "
        "are then taken as well. 'mean over headings' is the texture's own "
        "mean, which a model that does not know the heading reaches at best. The models of "
        "'speed and force' and of 'velocity and force' are built from the same session."
    ),
    "distance": (
        "Sum over the nine cells of the speed-force plane of the distances from a cell's "
        "centre to the three nearest samples, in the plane divided by 300 mm/s and 3 N; for a "
        "model of velocity and force, over 27 cells and the four nearest samples."
    ),
    "truth": (
        "The known texture is compared as it is at the surface: the accelerometer's noise and "
        "the 10 Hz high-pass of the modelling are not taken out of the model's error."
    ),
    "completion": (
        "What the completion criterion in use says: the distance, or with the criterion "
        "'uncertainty' the share of the operator's strokes whose level is expected to be within "
        "one JND."
    ),
}
"""How each score is defined, in a sentence."""


def number(value: float | None, digits: int) -> str:
    """Return a number with this many decimals."""
    return "-" if value is None else f"{value:.{digits}f}"


def seconds(value: float | None) -> str:
    """Return the time at which a criterion was met, or "never"."""
    return "never" if value is None else f"{value:.1f}"


def share(value: float | None) -> str:
    """Return a share in percent."""
    return "-" if value is None else f"{100 * value:.0f} %"
