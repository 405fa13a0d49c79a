"""Frames and times of a .tlog, also of one with junk bytes and steps of its clock.

Each frame stands behind its time: microseconds since 1970 in 64 bits, big endian.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Final, NamedTuple

from sitl_mock.errors import ConfigError
from sitl_mock.mavlink import Counts, Decoder

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from sitl_mock.mavlink import Message

_TIME: Final = struct.Struct(">Q")
_TIME_LITTLE: Final = struct.Struct("<Q")
_HEADER = 3
_V1 = 0xFE
_V2 = 0xFD
_V1_AROUND = 8
_V2_AROUND = 12
_SIGNATURE = 13
_YEAR_2000_US: Final = 946_684_800 * 10**6
_YEAR_2200_US: Final = 7_258_118_400 * 10**6
LONGEST_GAP_S: Final = 60.0
"""A longer silence is real only if the vehicle's own clock has advanced as much."""
_ALIKE_S: Final = 5.0
"""Greatest difference between the recording clock and the vehicle's over a long silence."""


_ONE_FRAME: Final = Counts(frames=1)


class TimedFrame(NamedTuple):
    """One frame with its recorded time (µs) and its message."""

    at_us: int
    message: Message
    frame: bytes


class _Read(NamedTuple):
    """Place of a frame behind its time, and its message if the decoder knows it."""

    at: int
    end: int
    message: Message | None


def read_frames(path: Path, raw: bytes) -> tuple[list[TimedFrame], list[str]]:
    """Return the frames that the mock's dialect knows, and notes about the rest.

    A frame that was cut off at the end, as by a killed recorder, is left out without a note.

    Raises:
        ConfigError: There is not one frame in a file that is not empty.
    """
    reads, skipped = _scan(raw)
    if raw and not reads:
        raise ConfigError(f"{path}: no MAVLink frame in {len(raw)} bytes; is this a .tlog?")
    notes = []
    if skipped:
        notes.append(f"{skipped} of {len(raw)} bytes are no MAVLink frames and are skipped")
    # Times are big endian unless the first one makes sense only in the other order.
    clock = _TIME
    if reads:
        times_us = [order.unpack_from(raw, reads[0].at)[0] for order in (_TIME, _TIME_LITTLE)]
        big, little = (_YEAR_2000_US < time_us < _YEAR_2200_US for time_us in times_us)
        clock = _TIME_LITTLE if little and not big else _TIME
    if clock is _TIME_LITTLE:
        notes.append("the recorded times are little-endian")
    frames = []
    for read in reads:
        (at_us,) = clock.unpack_from(raw, read.at)
        if read.message is not None:
            frames.append(TimedFrame(at_us, read.message, raw[read.at + clock.size : read.end]))
    return frames, notes


def _scan(raw: bytes) -> tuple[list[_Read], int]:
    """Find every frame; after bytes that are none, continue at the next frame with a right checksum."""
    reads: list[_Read] = []
    skipped = 0
    at = 0
    while at < len(raw):
        read = _read_at(raw, at)
        if read is not None and read.message is None:
            # A frame of an unknown message is one only before another frame or the end of the file.
            following = read.end + _TIME.size
            if following + _HEADER <= len(raw) and _size(raw, following) is None:
                read = None
        if read is None:
            read = _next_known(raw, at + 1)
            if read is None:
                # A file may end within a frame, or within the time before one.
                start = at + _TIME.size
                size = _size(raw, start)
                is_cut_off = size is not None and start + size > len(raw)
                if start + _HEADER <= len(raw) and not is_cut_off:
                    skipped += len(raw) - at
                break
            skipped += read.at - at
        reads.append(read)
        at = read.end
    return reads, skipped


def _size(raw: bytes, start: int) -> int | None:
    """Size of the frame that begins here; None if none does."""
    if start + _HEADER > len(raw):
        return None
    magic = raw[start]
    length = raw[start + 1]
    if magic == _V1:
        return length + _V1_AROUND
    if magic == _V2:
        return length + _V2_AROUND + (_SIGNATURE if raw[start + 2] & 1 else 0)
    return None


def _read_at(raw: bytes, at: int) -> _Read | None:
    """Return the whole frame behind the time at `at`."""
    start = at + _TIME.size
    size = _size(raw, start)
    if size is None or start + size > len(raw):
        return None
    decoder = Decoder()
    messages = decoder.feed(raw[start : start + size], whole=True)
    right = decoder.counts == _ONE_FRAME
    return _Read(at, start + size, messages[0] if right else None)


def _next_known(raw: bytes, at: int) -> _Read | None:
    """Return the next frame that the decoder knows."""
    for start in range(at + _TIME.size, len(raw)):
        if raw[start] not in {_V1, _V2}:
            continue
        read = _read_at(raw, start - _TIME.size)
        if read is not None and read.message is not None:
            return read
    return None


def steady_times(frames: Sequence[TimedFrame], ids: tuple[int, int]) -> tuple[list[float], int]:
    """Return the time of every frame (s, from the first one), never falling, and the number of clock steps.

    Args:
        frames: In the order of the file.
        ids: System and component id of the vehicle, whose `time_boot_ms` judges long silences.
    """
    # The vehicle's clock at every frame: that of the next message with a clock, 0 after the last one.
    clocks_s = [0.0] * len(frames)
    own_clock_s = 0.0
    for index in reversed(range(len(frames))):
        message = frames[index].message
        boot_ms = getattr(message, "time_boot_ms", None)
        from_vehicle = (message.get_srcSystem(), message.get_srcComponent()) == ids
        if from_vehicle and boot_ms is not None:
            own_clock_s = boot_ms * 1e-3
        clocks_s[index] = own_clock_s
    times_s = [0.0]
    steps = 0
    for before, after, clock_s, next_clock_s in zip(
        frames, frames[1:], clocks_s, clocks_s[1:], strict=False
    ):
        passed_s = (after.at_us - before.at_us) * 1e-6
        if not -1.0 <= passed_s <= LONGEST_GAP_S:
            own_s = next_clock_s - clock_s
            steps += abs(passed_s - own_s) > _ALIKE_S
            if abs(passed_s - own_s) > _ALIKE_S:
                passed_s = own_s if 0.0 <= own_s <= LONGEST_GAP_S else 0.0
        times_s.append(times_s[-1] + max(passed_s, 0.0))
    return times_s, steps
