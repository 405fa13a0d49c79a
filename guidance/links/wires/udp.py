"""UDP: call a port (`udpout`) or listen and learn the sender's address (`udpin`).

Anybody can send to a listening port. `AddressPins` accepts each MAVLink system from one address at a time. Only signing
proves who sent a frame: with a key, only a validly signed frame can pin an address.
"""

import contextlib
import select
import socket
import threading
import time
from collections import Counter, deque
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from guidance.errors import LinkError
from guidance.links.mavlink.frames import (
    KNOWN,
    CheckedBytes,
    Frame,
    FrameReader,
    SignatureCheck,
    header_of,
)
from guidance.links.port import Clock
from guidance.links.wires.base import Packet, QueuedWire, Reader

_WAIT_MS: Final = 100
_DATAGRAM_BYTES: Final = 65535
_BATCH: Final = 16
"""Datagrams read at once; then another thread may run."""

_Address = tuple[str, int]

ADDRESS_SILENT_S: Final = 3.0
"""After this silence of a pinned address, another address may take its place."""

MAX_SYSTEMS: Final = 8
"""Largest number of pinned systems if any system is allowed."""

STRANGERS_PER_S: Final = 50
"""Frames per second from systems that are not expected; they let an error name who is there instead."""

MAX_READERS: Final = 16
"""Largest number of addresses whose cut frames are joined."""

IMPOSTORS_PER_S: Final = 10
"""Datagrams per second and message id from an address that is not the pinned one."""


@dataclass(slots=True)
class _Pin:
    """The address of one system: the current one, when it was heard last, and the first one ever."""

    address: _Address
    heard_s: float
    first: _Address


class AddressPins:
    """Decides by sender address which frames of a datagram are accepted.

    Each system is accepted from one address, which is pinned by its first valid frame. Another address replaces it
    after `ADDRESS_SILENT_S` of silence. The first address ever pinned gets its pin back at once when it returns. With a
    key, a validly signed frame, which is newer than every one before it, pins its address at once.

    Every frame is judged by the pin of its own system, also behind other bytes: the pin of one system
    is valid for no other one.

    Args:
        systems: MAVLink system ids that are accepted; None accepts any, at most `MAX_SYSTEMS` at once.
        checks: Signature checks by system id. Such a system is pinned by a validly signed frame only, and only such
            frames count as heard.
    """

    def __init__(
        self,
        systems: Collection[int | None] | None = None,
        checks: Mapping[int | None, SignatureCheck] | None = None,
    ) -> None:
        self._systems = None if systems is None else frozenset(systems)
        self._checks = checks or {}
        self._pins: dict[int, _Pin] = {}
        self.addresses: tuple[_Address, ...] = ()
        """Every pinned address once; replaced, never changed, as another thread may be iterating."""
        self._reader = FrameReader(())
        self._readers: dict[_Address, FrameReader] = {}
        self._second = -1
        self._budget: Counter[int] = Counter()
        self.refused = Counter(garbage=0, impostor=0, stranger=0, unsigned=0, unsaved=0)
        self.impostors_of: Counter[int] = Counter()
        """Number of refused frames with a pinned system's id from another address, by system."""
        self.impostors: deque[bytes] = deque(maxlen=256)
        """Frames with a pinned system's id from another address, at most `IMPOSTORS_PER_S` per message id."""

    def admit(self, now_s: float, address: _Address, data: bytes) -> bytes:
        """Return the accepted frames that a datagram completes; of an unexpected system only the first one."""
        # At MAX_READERS, the address without a pin that was silent longest loses its reader.
        reader = self._readers.pop(address, None) or FrameReader(())
        if len(self._readers) >= MAX_READERS:
            others = [other for other in self._readers if other not in self.addresses]
            del self._readers[next(iter(others or self._readers))]
        self._readers[address] = reader  # at the end: the first one was silent longest
        garbage_bytes = reader.garbage_bytes
        if address in self.addresses:
            frames = reader.split(data)
        else:
            cut = header_of(data) is None  # perhaps by a bridge from a serial line
            frames = reader.split(data) if cut else []
            reason = self._knock(now_s, address, frames[0].data if frames else data)
            if reason is not None:
                return reason
            frames = frames if cut else reader.split(data)
        if not frames:
            return self._refuse("garbage") if reader.garbage_bytes > garbage_bytes else b""
        admitted = [frame for frame in frames if self._admits(now_s, address, frame)]
        checked = CheckedBytes(b"".join([frame.data for frame in admitted]))
        checked.frames = admitted
        return checked

    def _knock(self, now_s: float, address: _Address, data: bytes) -> bytes | None:
        """Pin a new address by the first frame of its datagram, or return the bytes accepted without a pin.

        Floods come from here, so most datagrams are refused by their header.
        """
        header = header_of(data)
        if header is None or not self._is_expected(header[0], now_s):
            return self._stranger(now_s, data)
        system_id = header[0]
        if system_id not in self._checks and not self._may_take(now_s, address, system_id):
            return self._impostor(now_s, data)
        frame = self._reader.first(data)
        if frame is None:
            return self._refuse("garbage")
        check = self._checks.get(system_id)
        problem = None if check is None else check.problem(frame, remember=False)
        if problem == "unsaved":
            return self._refuse("unsaved")
        if problem is None:
            return None
        return self._impostor(now_s, data) if system_id in self._pins else self._refuse("unsigned")

    def _admits(self, now_s: float, address: _Address, frame: Frame) -> bool:
        """Judge one valid frame by its own system's pin."""
        system_id = frame.system_id
        if self._systems is not None and system_id not in self._systems:
            return True  # forwarded by the vehicle's own link; such a system has no pin
        pin = self._pins.get(system_id)
        check = self._checks.get(system_id)
        if check is not None:
            if check.problem(frame) is None:
                self._pin(now_s, address, system_id)
                return True
            if pin is None or pin.address == address:
                return True  # the link refuses it, and counts why
        elif pin is not None and pin.address == address:
            pin.heard_s = now_s
            return True
        elif self._may_take(now_s, address, system_id):
            if self._is_expected(system_id, now_s):
                self._pin(now_s, address, system_id)
            return True
        self._impostor(now_s, frame.data)
        return False

    def _may_take(self, now_s: float, address: _Address, system_id: int) -> bool:
        """True if an address may become a system's: there is none, it was silent, or it is the first one again."""
        pin = self._pins.get(system_id)
        if pin is None:
            return True
        return address in (pin.address, pin.first) or now_s - pin.heard_s >= ADDRESS_SILENT_S

    def _pin(self, now_s: float, address: _Address, system_id: int) -> None:
        """Make this the address of a system."""
        pins = self._pins
        held = pins.get(system_id)
        if held is not None and held.address == address:
            held.heard_s = now_s
            return
        if held is None and self._systems is None and len(pins) >= MAX_SYSTEMS:
            del pins[self._silent_longest()]
        pins[system_id] = _Pin(address, now_s, address if held is None else held.first)
        self.addresses = tuple({pin.address: None for pin in pins.values()})

    def _is_expected(self, system_id: int, now_s: float) -> bool:
        if self._systems is not None:
            return system_id in self._systems
        if system_id in self._pins or len(self._pins) < MAX_SYSTEMS:
            return True
        return now_s - self._pins[self._silent_longest()].heard_s >= ADDRESS_SILENT_S

    def _silent_longest(self) -> int:
        return min(self._pins, key=lambda system_id: self._pins[system_id].heard_s)

    def _refuse(self, reason: str) -> bytes:
        self.refused[reason] += 1
        return b""

    def _impostor(self, now_s: float, data: bytes) -> bytes:
        """Count it, whatever its checksum, and keep a few for the detection of a second source."""
        header = header_of(data)
        if header is None:
            return self._refuse("garbage")
        system_id, message_id = header
        self.impostors_of[system_id] += 1
        if message_id in KNOWN and self._within_budget(now_s, message_id, IMPOSTORS_PER_S):
            self.impostors.append(data)
        return self._refuse("impostor")

    def _stranger(self, now_s: float, data: bytes) -> bytes:
        frame = self._reader.first(data)
        if frame is not None and self._within_budget(now_s, -1, STRANGERS_PER_S):
            return frame.data
        return self._refuse("garbage" if frame is None else "stranger")

    def _within_budget(self, now_s: float, key: int, per_s: int) -> bool:
        if int(now_s) != self._second:
            self._second = int(now_s)
            self._budget.clear()
        self._budget[key] += 1
        return self._budget[key] <= per_s


class UdpWire(QueuedWire):
    """One socket. A listening wire hears and answers one address per system, see `AddressPins`.

    Attributes:
        reading: Held by the thread that reads the socket.
    """

    def __init__(
        self,
        clock: Clock,
        host: str,
        port: int,
        pins: AddressPins | None = None,
        *,
        rest_s: float = 0.0,
    ) -> None:
        """Open the socket. With `pins` it listens for the systems that they accept; without, it calls the address.

        Args:
            clock: Stamps arrivals.
            host: To listen at or to call.
            port: To listen at or to call.
            pins: Accepts systems.
            rest_s: The reader thread rests so long after it has read everything; a stamp may be so much late.

        Raises:
            LinkError: If the address cannot be bound or resolved.
        """
        super().__init__(clock)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._pins = pins
        self._rest_s = rest_s
        try:
            # Of a connected socket, the kernel drops datagrams from all other addresses.
            (self._socket.connect if pins is None else self._socket.bind)((host, port))
        except OSError as error:
            self._socket.close()
            busy = "choose another port or end the program that uses it"
            wrong = "is the host name right?"
            raise LinkError(
                f"udp {host}:{port}: {error}; {wrong if pins is None else busy}"
            ) from error
        self._socket.setblocking(False)
        self._watched = select.poll()
        self._readable = select.poll()  # for the reader thread; for the lock holder
        for poll in (self._watched, self._readable):
            poll.register(self._socket, select.POLLIN)
        # Read and queue in one step: two threads must not change the order
        self.reading = threading.Lock()
        self._reader = Reader(self._watch, name=f"udp {host}:{port}")

    @property
    def port(self) -> int:
        """The port of this computer, also where the system has chosen it (port 0)."""
        return int(self._socket.getsockname()[1])

    def _watch(self) -> None:
        """Wait for datagrams, on the reader thread."""
        if self._watched.poll(_WAIT_MS) and self._take_in() and self._rest_s > 0.0:
            time.sleep(self._rest_s)

    def _take_in(self) -> bool:
        """Queue up to `_BATCH` datagrams from the kernel, as far as they are accepted, unless the other thread does.

        Returns:
            True if the kernel holds no more.
        """
        if not self.reading.acquire(blocking=False):
            return True
        try:
            for _ in range(_BATCH):
                # Cheaper than the exception: 20 µs on a cold processor
                if not self._readable.poll(0):
                    return True
                data, address = self._socket.recvfrom(_DATAGRAM_BYTES)
                now_s = self._clock()
                if self._pins is not None:
                    data = self._pins.admit(now_s, address, data)
                if data:
                    self._arrivals.put((now_s, data))
        except OSError:
            pass  # nothing listens at the port that we call; it may later
        finally:
            self.reading.release()
        return False

    def receive(self) -> Sequence[Packet]:
        """Return the datagrams since the last call, including those that the kernel still holds.

        Reads the socket itself, since the reader thread may be waiting for this one to release the interpreter. Does
        not wait if the reader thread is reading.
        """
        self._take_in()
        return self._arrivals.take()

    def impostors_of(self, system_id: int) -> int:
        """Return how many frames with a system's id came from another address."""
        return 0 if self._pins is None else self._pins.impostors_of[system_id]

    def impostors(self) -> Sequence[bytes]:
        """Return datagrams since the last call with a pinned system's id from another address."""
        if self._pins is None:
            return ()
        kept = self._pins.impostors
        return [kept.popleft() for _ in range(len(kept))]

    def _write(self, frame: bytes) -> bool:
        """Send one datagram to each pinned address; without any, the frame is not sent."""
        addresses: Sequence[_Address | None] = (None,)
        if self._pins is not None:
            addresses = self._pins.addresses
        sent = 0
        for address in addresses:
            with contextlib.suppress(OSError):
                sent += bool(self._socket.sendmsg([frame], [], 0, address))
        return 0 < sent == len(addresses)

    def counters(self) -> Mapping[str, int]:
        """Return the counts of all wires, and how many datagrams of others were refused, by reason."""
        refused: Mapping[str, int] = {}
        if self._pins is not None:
            refused = self._pins.refused
        return {
            **super().counters(),
            **{f"wire_{reason}": count for reason, count in refused.items()},
        }

    def _release(self) -> None:
        self._reader.close()
        self._socket.close()
