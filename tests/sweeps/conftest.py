import shutil

import pytest

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

MIXED = """
scenario = "short.toml"
title = "Mixed"
seeds = 6
policies = [{ pursuer = ["optimal", "pure_pursuit"], evader = ["optimal", "random_turns"] }]
[grid]
"pursuer.speed_set" = ["ball", "cylinder"]
"time_limit_s" = [1.2, 4.0]
[random]
"evader.position_m" = { annulus = [8, 14] }
"evader.speed_m_s" = { normal = [5.0, 1.5] }
"""


@pytest.fixture
def short(tmp_path):
    """A folder with a scenario of two seconds and a sweep of 24 rows."""
    (tmp_path / "short.toml").write_text(SCENARIO)
    (tmp_path / "sweep.toml").write_text(SWEEP)
    return tmp_path


@pytest.fixture
def plan_from(short):
    def make(text=SWEEP, way=None):
        return _planned(text, short, way)

    return make


@pytest.fixture(scope="session")
def mixed_once(tmp_path_factory):
    """A sweep with captures, time-outs and invalid rows, in three chunks."""
    from guidance.sweeps.folder import begin_or_continue
    from guidance.sweeps.running import finish

    folder = tmp_path_factory.mktemp("mixed")
    (folder / "short.toml").write_text(SCENARIO)
    plan = _planned(MIXED, folder)
    finish(begin_or_continue(folder / "out", plan, 32), lambda _: None)
    return folder / "out"


@pytest.fixture
def undrawn(monkeypatch):
    """Reports are written without their pictures, which take most of the time."""
    from guidance.sweeps import report

    monkeypatch.setattr(report, "draw_all", lambda *_: [])


@pytest.fixture
def mixed(mixed_once, tmp_path):
    """A copy of the mixed sweep that a test may change."""
    from guidance.sweeps.folder import read_folder

    return read_folder(shutil.copytree(mixed_once, tmp_path / "out"))


def _planned(text, folder, way=None):
    from guidance.sweeps.rows import planned

    path = folder / "sweep.toml"
    path.write_text(text)
    return planned(str(path), way)
