"""The model of an emulated network: delay, jitter, loss, repetition, bandwidth, outages.

A pure model, which computes the arrival times of messages from the times and sizes of those sent.
It reads no clock and holds no message; equal seeds and equal messages give equal arrivals.
"""

import math
import random
from typing import Final

from mmt.scene import Network

_MS: Final = 1_000_000
_S: Final = 1_000_000_000
_DUPLICATES_NS: Final = 3 * _MS
"""Time until TCP detects a loss: three later packets, at 1 kHz, are acknowledged (RFC 5681); for a
retransmission, a packet sent after it is acknowledged (RFC 8985)."""
_ROOT_HALF: Final = math.sqrt(0.5)


class MessageImpairments:
    """Compute the arrivals of one direction's messages, in the order in which they are sent.

    A message sent during an outage is lost. With a limited bandwidth a message is queued behind
    earlier ones, and lost if the queue is full. Messages are lost at random with the probability
    ``loss``. The rest arrive after their delay, some of them twice. With ``retransmit`` a lost one
    is sent again as by TCP, and later ones wait for it. Takes a few microseconds a message.

    Parameters
    ----------
    settings
        The emulated network.
    seed
        Seed of the random numbers.
    start_ns
        When the first interval between outages begins.
    """

    def __init__(self, settings: Network, seed: int, start_ns: int) -> None:
        self._settings = settings
        self._start_ns = start_ns
        self._random = random.Random(seed)  # noqa: S311 - an emulation, no secret
        self._jitter = _Jitter(settings.jitter_time_ms * _MS, self._random)
        self._losses = _BurstLosses(settings, self._random)
        rate = settings.bandwidth_kbit_s
        self._ns_per_byte = 8 * _S / (rate * 1000) if rate is not None else 0.0
        self._free_ns = start_ns
        self._latest_ns: int | None = None

    def continue_from(self, earlier: "MessageImpairments") -> None:
        """Continue an earlier model: no message overtakes one of that model."""
        self._latest_ns = earlier._latest_ns

    def arrivals_ns(self, send_ns: int, size_bytes: int) -> tuple[int, ...]:
        """Return the times at which a message arrives: one, two, or none if it is lost.

        Parameters
        ----------
        send_ns
            When the message is sent; not before the previous one.
        size_bytes
            Length of the message, for the bandwidth.
        """
        if self._is_out(send_ns):
            return ()
        departure_ns = self._departure(send_ns, size_bytes)
        if departure_ns is None:
            return ()
        if self._losses.loses():
            if not self._settings.retransmit:
                return ()
            departure_ns += self._retransmission_ns()
        arrival_ns = self._arrival(departure_ns)
        share = self._settings.duplicate
        if share and self._random.random() < share:
            return (arrival_ns, self._arrival(departure_ns))
        return (arrival_ns,)

    def is_free(self, now_ns: int) -> bool:
        """Return whether a message sent now would not be queued for the bandwidth."""
        return self._free_ns <= now_ns

    def _is_out(self, send_ns: int) -> bool:
        """Return whether there is an outage; each lasts to the end of its interval."""
        settings = self._settings
        if not settings.outage_s:
            return False
        every_ns = round(settings.outage_every_s * _S)
        return (send_ns - self._start_ns) % every_ns >= every_ns - round(settings.outage_s * _S)

    def _departure(self, send_ns: int, size_bytes: int) -> int | None:
        """Return when the last bit has been sent, or None if the queue was full."""
        if not self._ns_per_byte:
            return send_ns
        begin_ns = max(send_ns, self._free_ns)
        if begin_ns - send_ns > self._settings.queue_ms * _MS:
            return None
        self._free_ns = begin_ns + round(size_bytes * self._ns_per_byte)
        return self._free_ns

    def _retransmission_ns(self) -> int:
        """Return the delay of a lost message's last retransmission, which arrives (ns)."""
        times = 1
        while self._random.random() < self._settings.loss:
            times += 1
        return times * (round(2 * self._settings.delay_ms * _MS) + _DUPLICATES_NS)

    def _arrival(self, departure_ns: int) -> int:
        settings = self._settings
        delay_ms = settings.delay_ms
        if settings.jitter_ms:
            delay_ms += settings.jitter_ms * self._jitter.at(departure_ns)
        arrival_ns = departure_ns + round(delay_ms * _MS)
        if not settings.reorder:
            if self._latest_ns is not None:
                arrival_ns = max(arrival_ns, self._latest_ns)
            self._latest_ns = arrival_ns
        return arrival_ns


class _BurstLosses:
    """The Gilbert-Elliott channel: a bad state that loses messages, and a good one without loss.

    E. O. Elliott: *Estimates of Error Rates for Codes on Burst-Noise Channels*, Bell System
    Technical Journal 42, 1963, with the good state without loss. The share of the bad state
    follows from the loss. A mean burst shorter than that of independent losses is lengthened
    to it, so that bursts of 1 are independent losses.
    """

    def __init__(self, settings: Network, generator: random.Random) -> None:
        self._random = generator
        self._burst_loss = settings.burst_loss
        bad = settings.loss / settings.burst_loss
        if bad < 1.0:
            burst = max(settings.burst_messages, 1.0 / (1.0 - bad))
            self._leave = 1.0 / burst
            self._enter = bad / (burst * (1.0 - bad))
        else:
            self._leave, self._enter = 0.0, 1.0
        self._active = bad > 0.0
        self._is_bad = self._active and generator.random() < bad

    def loses(self) -> bool:
        """Return whether the next message is lost."""
        if not self._active:
            return False
        lost = self._is_bad and (
            self._burst_loss >= 1.0 or self._random.random() < self._burst_loss
        )
        change = self._leave if self._is_bad else self._enter
        if self._random.random() < change:
            self._is_bad = not self._is_bad
        return lost


class _Jitter:
    """Values distributed uniformly within -1 to 1, independent or smoothly correlated in time.

    With a correlation time they are a stationary Gaussian process with the Matern covariance
    of order 3/2, (1 + t/T) exp(-t/T), sampled exactly at any times, through the normal
    distribution function. It has a derivative, so that slow jitter shifts messages without
    changing their order.
    """

    def __init__(self, time_ns: float, generator: random.Random) -> None:
        self._time_ns = time_ns
        self._random = generator
        self._value, self._slope = generator.gauss(0.0, 1.0), generator.gauss(0.0, 1.0)
        self._at_ns: int | None = None

    def at(self, time_ns: int) -> float:
        """Return the value at a time not before that of the last call."""
        if not self._time_ns:
            return 2.0 * self._random.random() - 1.0
        if self._at_ns is not None and time_ns > self._at_ns:
            self._advance((time_ns - self._at_ns) / self._time_ns)
        self._at_ns = time_ns
        return math.erf(self._value * _ROOT_HALF)

    def _advance(self, step: float) -> None:
        """Advance by a multiple of the correlation time; the slope is in units of its inverse."""
        decay = math.exp(-step)
        value = decay * ((1.0 + step) * self._value + step * self._slope)
        slope = decay * (-step * self._value + (1.0 - step) * self._slope)
        square = decay * decay
        # conditional variances after the transition; rounding may make them negative
        of_value = max(0.0, 1.0 - square * ((1.0 + step) ** 2 + step**2))
        common = 2.0 * square * step**2
        of_slope = max(0.0, 1.0 - square * (step**2 + (1.0 - step) ** 2))
        first, second = self._random.gauss(0.0, 1.0), self._random.gauss(0.0, 1.0)
        root = math.sqrt(of_value)
        across = common / root if root > 0.0 else 0.0
        self._value = value + root * first
        self._slope = slope + across * first + math.sqrt(max(0.0, of_slope - across**2)) * second
