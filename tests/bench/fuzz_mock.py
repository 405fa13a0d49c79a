"""Fire hostile frames at flying mock vehicles: `python tests/bench/fuzz_mock.py --frames 1000000`.

For each flavour, with and without signing, two equal vehicles are flown by the same client in stepped time; one of them
takes the hostile frames too. Printed are the frames by kind of count, the time for each, and whether the two vehicles
sent the same bytes throughout. A second run fires frames that are right in form but carry any bits, and counts
exceptions. The exit status is 1 if anything differed or was raised.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "sitl_mock"))

from hostile import HostileTraffic

from sitl_mock.mavlink import Encoder, Signing
from sitl_mock.vehicle.mock_vehicle import MockVehicle

KEY = bytes(range(32))
GUIDED = {"px4": (1.0, 6.0), "arducopter": (1.0, 4.0), "rover": (1.0, 15.0)}
STEP_S = 0.05
PER_STEP = 500
SETUP_SIGNING = 256


def client_frames(encoder: Encoder, flavour: str, tick: int) -> list[bytes]:
    """Return what a client sends that flies guided at 2 m/s."""
    frames = [
        encoder.pack(
            "SET_POSITION_TARGET_LOCAL_NED",
            tick,
            1,
            1,
            1,
            2503,
            0,
            0,
            0,
            2.0,
            0.0,
            -0.1,
            0,
            0,
            0,
            0.0,
            0.0,
        )
    ]
    if tick % 20 == 0:
        frames.append(encoder.pack("HEARTBEAT", 6, 8, 0, 0, 4, 3))
    if tick % 20 == 10:
        frames.append(encoder.pack("COMMAND_LONG", 1, 1, 176, 0, *GUIDED[flavour], *[0.0] * 5))
        frames.append(encoder.pack("COMMAND_LONG", 1, 1, 400, 0, 1.0, *[0.0] * 6))
    return frames


def vehicle(flavour: str, key: bytes | None) -> MockVehicle:
    """Return a vehicle that can be armed after half a second."""
    return MockVehicle(flavour, seed=3, ready_after_s=0.5, signing=Signing(key) if key else None)


def fire(flavour: str, key: bytes | None, frames: int, seed: int) -> bool:
    """Fire at one of two twins and compare; return whether they stayed equal."""
    target = vehicle(flavour, key)
    twin = vehicle(flavour, key)
    encoder = Encoder(255, 190, signing=Signing(key, timestamp=10**9) if key else None, link_id=5)
    traffic = HostileTraffic(seed)
    sources = list((traffic.kinds_against_signing if key else traffic.kinds).values())
    spent_s = 0.0
    differences = 0
    for tick in range(frames // PER_STEP):
        good = client_frames(encoder, flavour, tick)
        bad = [sources[index % len(sources)]() for index in range(PER_STEP)]
        begin_s = time.perf_counter()
        under_fire = target.step(tick * STEP_S, bad + good)
        spent_s += time.perf_counter() - begin_s
        differences += under_fire != twin.step(tick * STEP_S, good)
    counts = next(iter(target.links.values())).decoder.counts.as_dict()
    named = ", ".join(f"{kind} {count}" for kind, count in counts.items() if count)
    print(
        f"{flavour:<10} {'signed' if key else 'open':<6} {frames} frames, {spent_s / frames * 1e6:.1f} µs each, "
        f"{differences} of {frames // PER_STEP} steps differ from the twin, armed {target.armed}; {named}"
    )
    return differences == 0


def any_bits(flavour: str, frames: int, seed: int) -> bool:
    """Send valid frames with random field bits; return True if there was no exception."""
    target = vehicle(flavour, None)
    traffic = HostileTraffic(seed)
    encoder = Encoder(255, 190)
    raised: Counter[str] = Counter()
    for tick in range(frames // PER_STEP):
        own = [
            f
            for f in (traffic.own() for _ in range(PER_STEP))
            if int.from_bytes(f[7:10], "little") != SETUP_SIGNING
        ]
        for frame in own + client_frames(encoder, flavour, tick):
            try:
                target.step(tick * STEP_S, [frame])
            except Exception as error:
                raised[f"{type(error).__name__}: {error}"[:100]] += 1
    print(
        f"{flavour:<10} any bits in {frames} frames: {sum(raised.values())} exceptions {dict(raised.most_common(3))}"
    )
    return not raised


def main() -> int:
    """Run all and return the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--frames", type=int, default=1_000_000, help="hostile frames in all (default 1000000)"
    )
    parser.add_argument("--seed", type=int, default=1, help="seed of the traffic (default 1)")
    options = parser.parse_args()
    flavours = tuple(GUIDED)
    each = max(PER_STEP, options.frames // (3 * len(flavours)))
    fine = [fire(flavour, key, each, options.seed) for flavour in flavours for key in (None, KEY)]
    fine += [any_bits(flavour, each, options.seed + 1) for flavour in flavours]
    return 0 if all(fine) else 1


if __name__ == "__main__":
    sys.exit(main())
