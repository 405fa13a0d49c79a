"""Hypothesis draws the same examples in every run, so that a test that failed fails again; and no wall clock judges.

`HYPOTHESIS_PROFILE=search python -m tests tests` draws new ones.
"""

import os

from hypothesis import settings

settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile("search", deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))
