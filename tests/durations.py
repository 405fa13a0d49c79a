"""`python -m tests durations`: the processor time of each test in the last run of each step.

Processor time counts what a test and its child processes compute; a test that waits, or a busy machine, adds nothing.
The set-up of a shared fixture counts for the test that came first.
"""

import argparse
import json
from collections import Counter
from collections.abc import Sequence

from tests.__main__ import COSTLY, EVERY, ROOT, SHORT_S, cache_of, costly


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the slowest tests and files of each step."""
    parser = argparse.ArgumentParser(prog="python -m tests durations", description=__doc__)
    parser.add_argument("--most", type=int, default=20, metavar="N", help="rows of each table")
    parser.add_argument(
        "--write", action="store_true", help=f"list the tests above {SHORT_S:g} s in {COSTLY.name}"
    )
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
            print(f"{len(long)} need more than {SHORT_S:g} s: shorten them, or list them (--write)")
    if given.write:
        _write()
    return 0


def _write() -> None:
    """List the tests that were costly when they last ran; forget those that are gone."""
    listed = costly()
    for name in ("tests", "flights"):
        results = cache_of(name) / "v" / "tests"
        if results.is_file():
            listed |= {test: spent for test, (_, spent) in json.loads(results.read_text()).items()}
    sources = {test.partition("::")[0] for test in listed}
    texts = {file: (ROOT / file).read_text() for file in sources if (ROOT / file).is_file()}
    lines = []
    for test, spent in sorted(listed.items()):
        file, _, function = test.partition("::")
        there = f"def {function.partition('[')[0].rpartition('::')[2]}(" in texts.get(file, "")
        if spent > SHORT_S and there:
            lines.append(f"{spent:.2f} {test}\n")
    COSTLY.write_text("".join(lines), encoding="utf-8")
    print(f"{len(lines)} tests are listed in {COSTLY.name}")


if __name__ == "__main__":
    raise SystemExit(main())
