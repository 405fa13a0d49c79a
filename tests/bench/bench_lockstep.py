"""One client flies many times in lockstep, with idle processors and under load: how many different answers?

python -m tests.bench.bench_lockstep --runs 100 --load 10
"""

import argparse
import multiprocessing
import time

from sitl_mock.child import running
from tests.harness.stepper import take_off


def burn(stop: object) -> None:
    """Keep a processor busy."""
    while not stop.is_set():
        sum(range(1000))


def answers(runs: int) -> tuple[set[str], float]:
    """Fly so many times; return the digests of what came, and the mean time of a flight."""
    digests = set()
    began_s = time.monotonic()
    for _ in range(runs):
        table = {"name": "uav1", "flavour": "px4", "ready_after_s": 0.5}
        with running([table], over=("udp",), lockstep=True) as fleet:
            digests.add(take_off(fleet["uav1"])[0])
    return digests, (time.monotonic() - began_s) / runs


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--load", type=int, default=10)
    arguments = parser.parse_args()
    idle, idle_s = answers(arguments.runs)
    stop = multiprocessing.Event()
    burners = [
        multiprocessing.Process(target=burn, args=(stop,), daemon=True)
        for _ in range(arguments.load)
    ]
    for burner in burners:
        burner.start()
    loaded, loaded_s = answers(arguments.runs)
    stop.set()
    print(
        f"{arguments.runs} flights at load 0 ({idle_s:.2f} s each) and at load {arguments.load} "
        f"({loaded_s:.2f} s each): {len(idle | loaded)} different answers"
    )


if __name__ == "__main__":
    main()
