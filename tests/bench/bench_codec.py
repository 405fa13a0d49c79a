"""Time the codec and the streams beside pymavlink: `python tests/bench/bench_codec.py`.

Printed are microseconds per frame here and in pymavlink 2 for the same messages, and the ratio; then the cost of a
vehicle's streams for one simulated second at PX4's onboard rates.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import all as dialect

from sitl_mock.mavlink import SPEC_BY_NAME, Decoder, Encoder, Signing
from sitl_mock.protocols import PX4_ONBOARD_HZ, PX4_STREAM_RULES, Streams

if TYPE_CHECKING:
    from collections.abc import Callable

KEY = bytes(range(32))
REPEATS = 20_000
MESSAGES: dict[str, tuple[Any, ...]] = {
    "LOCAL_POSITION_NED": (12345, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0),
    "SET_POSITION_TARGET_LOCAL_NED": (
        1,
        1,
        1,
        1,
        2503,
        0.0,
        0.0,
        0.0,
        1.0,
        2.0,
        3.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
    ),
    "HEARTBEAT": (2, 12, 81, 0, 4, 3),
    "PARAM_VALUE": (b"MPC_XY_VEL_MAX", 12.0, 9, 128, 70),
    "ODOMETRY": (
        1,
        1,
        12,
        1.0,
        2.0,
        3.0,
        [1.0, 0.0, 0.0, 0.0],
        *[0.1] * 6,
        [0.0] * 21,
        [0.0] * 21,
        0,
        2,
        100,
    ),
    "FILE_TRANSFER_PROTOCOL": (0, 1, 1, [7] * 251),
}


def microseconds(call: Callable[[], object]) -> float:
    """Return the best of five means."""
    best = float("inf")
    for _ in range(5):
        begin = time.perf_counter()
        for _ in range(REPEATS // 5):
            call()
        best = min(best, (time.perf_counter() - begin) / (REPEATS // 5))
    return best * 1e6


def pymavlink(*, key: bytes | None = None) -> Any:
    """Return pymavlink's codec, with or without a key."""
    mav = dialect.MAVLink(None, 1, 1)
    if key is not None:
        mav.signing.secret_key = key
        mav.signing.sign_outgoing = True
    return mav


def row(title: str, ours: float, pymavlinks: float) -> None:
    """Print one comparison."""
    print(
        f"{title:<44} {ours:7.2f} µs {pymavlinks:7.2f} µs   {pymavlinks / ours:4.1f} times as fast"
    )


def pack_and_parse(name: str, values: tuple[Any, ...], key: bytes | None) -> None:
    """Compare both directions for one message."""
    cls = dialect.mavlink_map[SPEC_BY_NAME[name].message_id]
    encoder = Encoder(1, 1, signing=Signing(key) if key else None)
    reference = pymavlink(key=key)
    signed = " signed" if key else ""
    row(
        f"pack {name}{signed}",
        microseconds(lambda: encoder.pack(name, *values)),
        microseconds(lambda: cls(*values).pack(reference)),
    )
    frame = Encoder(1, 1).pack(name, *values)
    decoder = Decoder()
    parser = pymavlink()
    if not key:
        row(
            f"parse {name}",
            microseconds(lambda: decoder.feed(frame, whole=True)),
            microseconds(lambda: parser.parse_buffer(frame)),
        )


def streams() -> None:
    """Time a vehicle's streams over a minute in steps of 10 ms."""
    running = Streams(frozenset(PX4_ONBOARD_HZ), PX4_ONBOARD_HZ, PX4_STREAM_RULES)
    begin = time.perf_counter()
    sent = 0
    for step in range(6000):
        sent += len(running.due(step * 0.01))
    spent_ms = (time.perf_counter() - begin) * 1e3 / 60.0
    print(
        f"streams: {sent / 60.0:.0f} messages in a second at PX4's onboard rates cost {spent_ms:.2f} ms of it"
    )


def main() -> None:
    """Run all."""
    print(f"{'':<44} {'here':>10} {'pymavlink':>10}")
    for name, values in MESSAGES.items():
        pack_and_parse(name, values, None)
    pack_and_parse("LOCAL_POSITION_NED", MESSAGES["LOCAL_POSITION_NED"], KEY)
    streams()


if __name__ == "__main__":
    main()
