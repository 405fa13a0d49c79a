import tomllib

import pytest

from guidance.config import parse
from guidance.sweeps.model import Sweep
from guidance.sweeps.plan import laid_out
from guidance.sweeps.rows import check

SCENARIO = """
title = "Short"
game = "pe"
[pursuer]
position_m = [0.0, 0.0, 7.0]
speed_m_s = 6.0
[evader]
position_m = [0.0, 12.0]
speed_m_s = 2.0
"""

SWEEP = """
scenario = "short.toml"
seeds = 6
policies = [{ pursuer = ["optimal", "pure_pursuit"], evader = "optimal" }]
[grid]
"evader.speed_m_s" = [1.0, 3.0]
[random]
"evader.position_m" = { annulus = [8, 14] }
"pursuer.position_m[2]" = { uniform = [5.0, 9.0] }
"""


@pytest.fixture
def short(tmp_path):
    """A folder with a scenario of two seconds and a sweep of 24 rows over it."""
    (tmp_path / "short.toml").write_text(SCENARIO)
    (tmp_path / "sweep.toml").write_text(SWEEP)
    return tmp_path


@pytest.fixture
def plan_from(short):
    def make(text=SWEEP, way=None):
        path = short / "sweep.toml"
        plan = laid_out(parse(Sweep, tomllib.loads(text), source=str(path)), path, way)
        check(plan, str(path))
        return plan

    return make
