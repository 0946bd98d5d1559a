"""A Net F/T box in software: web pages and records on ports of this machine."""

import http.server
import random
import socket
import threading
import time
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import parse_qsl, urlsplit

from mmt.devices.ati.net_wire import RECORD, START, STOP, parse_request
from mmt.testing.emulated import Clockwork, FaultySending, Truth

if TYPE_CHECKING:
    from mmt.testing.emulated.lab import World

_BOX_RATE_HZ: Final = 7000
_PAUSE_S: Final = 0.02


class EmulatedNetFt(FaultySending):
    """Answer as the box does, with faults on demand.

    Parameters
    ----------
    truth
        The force (N) at a time (ns) of the host's monotonic clock.
    clock_ppm
        How much too fast the box's clock runs.
    noise_n
        Standard deviation of the noise, without which values look stuck.
    seed
        Seed of the noise and the losses.
    """

    def __init__(
        self,
        truth: Truth,
        *,
        clock_ppm: float = 0.0,
        noise_n: float = 0.001,
        seed: int = 1,
    ) -> None:
        self.pages: dict[str, str] = {
            "setcfgsel": "0",
            "setuserfilter": "0",
            "setbias": "0;0;0;0;0;0",
            "cfgcalsel": "0",
            "cfgcpf": "1000000",
            "cfgcpt": "1000000",
            "scfgfu": "N",
            "scfgtu": "N-mm",
            "cfgmr": "12;12;17;120;120;120",
            "comrdte": "Enabled",
            "comrdtrate": "7000",
            "runrate": str(_BOX_RATE_HZ),
            "runstat": "0x00000000",
        }
        """Values of ``netftapi2.xml``; change them to emulate another box."""
        self.calibration = {"calsn": "FT00017", "calpn": "SI-12-0.12"}
        """Values of ``netftcalapi.xml``."""
        self.status = 0
        """Status of the records that follow."""
        self.loss = 0.0
        """Share of records that get lost."""
        self.swapped = 0.0
        """Share of records that come after their successor."""
        self.lost_starts = 0
        """Number of the next start requests that get lost."""
        self.requests: list[int] = []
        """Commands received."""
        self.truth = truth
        self._noise_n = noise_n
        self._rate_error = 1e-6 * clock_ppm
        self._random = random.Random(seed)  # noqa: S311 - noise, no secret
        self._garbage: list[bytes] = []
        self._sequence = 0
        self._plugged = True
        self._ended = threading.Event()
        self._threads: list[threading.Thread] = []
        self._client: Any = None
        self._held: bytes | None = None
        self._counts = (0, 0, 0, 0, 0, 0)

    def start(self) -> None:
        """Begin to listen."""
        self._udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._udp.bind(("127.0.0.1", 0))
        self._udp.settimeout(_PAUSE_S)
        self.host, self.rdt_port = self._udp.getsockname()
        box = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                box._answer(self)

            def log_message(self, format: str, *args: Any) -> None:  # noqa: A002
                """Say nothing."""

        self._http = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.http_port = self._http.server_address[1]
        for work in (self._listen, self._send, self._serve):
            thread = threading.Thread(target=work, name="emulated Net F/T", daemon=True)
            thread.start()
            self._threads.append(thread)

    def stop(self) -> None:
        """Stop, and release the ports."""
        self._ended.set()
        self._http.shutdown()
        for thread in self._threads:
            thread.join()
        self._http.server_close()
        self._udp.close()

    @property
    def options(self) -> dict[str, Any]:
        """Options by which the driver finds it."""
        return {"host": self.host, "rdt_port": self.rdt_port, "http_port": self.http_port}

    def unplug(self) -> None:
        """Stop answering and forget the client, as without power."""
        self._plugged = False
        self._client = None
        self._sequence = 0

    def plug(self) -> None:
        """Answer again."""
        self._plugged = True

    def garble(self, *packets: bytes) -> None:
        """Send these packets, which need not be records."""
        self._garbage.extend(packets)

    def count_from(self, sequence: int) -> None:
        """Give the next record the number after this one."""
        self._sequence = sequence & 0xFFFFFFFF

    def _listen(self) -> None:
        while not self._ended.is_set():
            try:
                packet, client = self._udp.recvfrom(2048)
            except OSError:  # nothing came, or the client's port is closed
                continue
            parsed = parse_request(packet)
            if parsed is None or not self._plugged:
                continue
            command, _count = parsed
            self.requests.append(command)
            if command == START:
                if self.lost_starts:
                    self.lost_starts -= 1
                elif self._client != client:
                    self._sequence = 0
                    self._client = client
            elif command == STOP and client == self._client:
                self._client = None

    def _send(self) -> None:
        due_ns = time.monotonic_ns()
        while not self._ended.is_set():
            rate_hz = float(self.pages["comrdtrate"]) * (1.0 + self._rate_error)
            due_ns += round(1e9 / rate_hz)
            wait_ns = due_ns - time.monotonic_ns()
            if wait_ns > 0:
                time.sleep(wait_ns / 1e9)
            client = self._client
            if client is None:
                continue
            self._sequence = (self._sequence + 1) & 0xFFFFFFFF
            packet = self._spoil(self._record(due_ns))
            if packet and self._random.random() >= self.loss:
                self._pass_on(packet, client)

    def _pass_on(self, packet: bytes, client: Any) -> None:
        packets = [*self._garbage, packet]
        self._garbage.clear()
        if self._held is not None:
            packets.append(self._held)
            self._held = None
        elif self._random.random() < self.swapped:
            self._held = packets.pop()
        for each in packets:
            try:
                self._udp.sendto(each, client)
            except OSError:  # the client is gone
                return

    def _record(self, time_ns: int) -> bytes:
        if not self.stuck:
            per_n, per_n_mm = float(self.pages["cfgcpf"]), float(self.pages["cfgcpt"])
            noise = self._random.gauss
            force = [
                round(per_n * (value + noise(0.0, self._noise_n))) for value in self.truth(time_ns)
            ]
            torque = [round(per_n_mm * noise(0.0, self._noise_n)) for _ in range(3)]
            x, y, z = (max(min(value, 2**31 - 1), -(2**31)) for value in force)
            self._counts = (x, y, z, torque[0], torque[1], torque[2])
        measurement = time_ns * _BOX_RATE_HZ // 1_000_000_000 & 0xFFFFFFFF
        return RECORD.pack(self._sequence, measurement, self.status, *self._counts)

    def _serve(self) -> None:
        self._http.serve_forever(poll_interval=_PAUSE_S)

    def _answer(self, handler: http.server.BaseHTTPRequestHandler) -> None:
        url = urlsplit(handler.path)
        if not self._plugged:
            return  # closes the connection without a word
        if url.path == "/netftapi2.xml":
            values = self.pages
        elif url.path == "/netftcalapi.xml":
            values = self.calibration
        elif url.path in {"/comm.cgi", "/setting.cgi"}:
            self._set(dict(parse_qsl(url.query)))
            values = {}
        else:
            handler.send_error(404)
            return
        body = "".join(f"<{name}>{value}</{name}>\n" for name, value in values.items())
        content = f'<?xml version="1.0" encoding="utf-8"?>\n<netft>\n{body}</netft>\n'.encode()
        handler.send_response(200)
        handler.send_header("Content-Length", str(len(content)))
        handler.end_headers()
        handler.wfile.write(content)

    def _set(self, values: dict[str, str]) -> None:
        if "comrdtrate" in values:
            divisor = max(1, _BOX_RATE_HZ // int(values["comrdtrate"]))
            self.pages["comrdtrate"] = str(_BOX_RATE_HZ // divisor)
        if "setuserfilter" in values:
            self.pages["setuserfilter"] = values["setuserfilter"]
        bias = self.pages["setbias"].split(";")
        self.pages["setbias"] = ";".join(values.get(f"setbias{i}", bias[i]) for i in range(6))


def in_lab(world: "World", seed: int, _clockwork: Clockwork) -> EmulatedNetFt:
    """Return the force sensor of the virtual lab."""
    return EmulatedNetFt(world.force_n, clock_ppm=40.0, seed=seed)
