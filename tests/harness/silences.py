"""When a vehicle was not heard in a flight in real time, and in what way: for a test that fails on it."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader

LONGEST_S = 0.3
LOCAL_POSITION_NED = 32


def silences(record: Path, topic: str = "pursuer/mavlink_raw/out") -> str:
    """Say where LOCAL_POSITION_NED came late, by our clock and by the vehicle's.

    Where both are as long, frames were lost; where its own is short, they, or its process, were held up.
    """
    if not record.is_file():
        return "there is no record"
    before = None
    lines = []
    for now_s, boot_s in _positions(record, topic):
        if before is not None and now_s - before[0] > LONGEST_S:
            silent_s = now_s - before[0]
            own_s = boot_s - before[1]
            lines.append(
                f"{before[0]:.2f} s: none for {silent_s:.2f} s, {own_s:.2f} s by its clock"
            )
        before = now_s, boot_s
    return "\n".join(
        [f"positions of {topic}, silent for more than {LONGEST_S:g} s:", *(lines or ["nowhere"])]
    )


def _positions(record: Path, topic: str) -> Iterator[tuple[float, float]]:
    with record.open("rb") as stream, contextlib.suppress(McapError):  # torn, maybe
        for _, _, message in NonSeekingReader(stream).iter_messages([topic], log_time_order=False):
            frame = message.data
            if frame[0] == 0xFD and int.from_bytes(frame[7:10], "little") == LOCAL_POSITION_NED:
                # Zeros at the end are left out
                boot_ms = int.from_bytes(frame[10 : 10 + min(4, frame[1])], "little")
                yield message.log_time * 1e-9, boot_ms * 1e-3
