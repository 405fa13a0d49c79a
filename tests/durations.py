"""`python -m tests durations`: the processor time of each test in the last run of each step.

Processor time counts what a test and its child processes compute; a test that waits, or a busy machine, adds nothing.
The set-up of a shared fixture counts for the test that came first.
"""

import argparse
import json
from collections import Counter
from collections.abc import Sequence

from tests.__main__ import EVERY, SHORT_S, cache_of


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the slowest tests and files of each step."""
    parser = argparse.ArgumentParser(prog="python -m tests durations", description=__doc__)
    parser.add_argument("--most", type=int, default=20, metavar="N", help="rows of each table")
    parser.add_argument("--step", choices=list(EVERY), help="of this step only")
    given = parser.parse_args(arguments)
    for name in [given.step] if given.step else EVERY:
        results = cache_of(name) / "v" / "tests"
        if not results.is_file():
            continue
        spent_s = Counter(
            {test: spent for test, (_, spent) in json.loads(results.read_text()).items()}
        )
        files = Counter[str]()
        for test, spent in spent_s.items():
            files[test.partition("::")[0]] += spent
        long = [test for test, spent in spent_s.items() if spent > SHORT_S]
        print(f"\n{name}: {len(spent_s)} tests, {spent_s.total():.1f} s of processor time")
        for table in (files, spent_s):
            for title, spent in table.most_common(given.most):
                print(f"{spent:8.2f} s  {title}")
            print()
        if name == "tests" and long:
            print(f"{len(long)} need more than {SHORT_S:g} s: mark them `flight`, or shorten them")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
