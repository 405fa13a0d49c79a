"""The number of examples that hypothesis draws for a property: an eighth by default, all of them in a search.

`python -m tests examples` draws all of them, the same in every run; `HYPOTHESIS_PROFILE=search` draws new ones.
"""

import math
import os

LEAST = 5
SHARE = {"same": 0.125, "mutants": 0.25}
PROFILE = os.environ.get("HYPOTHESIS_PROFILE", "same")


def drawn(count: int) -> int:
    """Return how many of `count` examples are drawn by this profile."""
    return max(min(count, LEAST), math.ceil(count * SHARE.get(PROFILE, 1.0)))
