"""A pytest plugin of `python -m tests mutants`: the tests that took least come first, so that most mutants cost little.

mutmut measures each test once, and names the tests that reach a mutant in any order.
"""

import json
from pathlib import Path

MEASURED = Path("mutmut-stats.json")
"""In the folder where mutmut runs the tests of mutants."""


def pytest_collection_modifyitems(items):
    """Sort the tests by their time in mutmut's measurement."""
    if MEASURED.exists():
        took_s = json.loads(MEASURED.read_text(encoding="utf-8"))["duration_by_test"]
        items.sort(key=lambda item: took_s.get(item.nodeid, 0.0))
