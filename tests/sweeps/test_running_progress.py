"""How far a sweep is: seen within a chunk, from every worker, and never more than there is."""

import io

from rich.console import Console

from guidance.sweeps.executors import ProcessExecutor, SerialExecutor
from guidance.sweeps.running import begun, finish, shown


def test_games_are_told_one_by_one_within_a_chunk(plan_from, tmp_path):
    plan, told = plan_from(), []
    executor = SerialExecutor(told.append)
    finish(begun(plan, tmp_path / "out", 12), executor, lambda rows: told.append(-rows))
    assert told == [*[1] * 12, -12, *[1] * 12, -12]


def test_games_of_every_worker_are_told_by_the_time_that_its_chunk_is_done(plan_from, tmp_path):
    plan, told = plan_from(), []
    executor = ProcessExecutor(2, told.append)
    try:
        finish(begun(plan, tmp_path / "out", 12), executor, lambda _: None)
    finally:
        executor.close()
    assert sum(told) == plan.rows


def lines(monkeypatch, terminal, **environment):
    now_s = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now_s[0])
    out = io.StringIO()
    console = Console(file=out, width=100, force_terminal=terminal, _environ=environment)
    with shown(console, 100, 20, unit="games") as sweep:
        for second in range(1, 31):
            now_s[0] = float(second)
            sweep.played(3)
            if second == 15:
                sweep.kept(40)
    return out.getvalue()


def test_where_nothing_can_be_redrawn_a_line_is_said_now_and_then_also_within_a_chunk(monkeypatch):
    said = [
        "50 of 100 games, 20 kept, 3 a second, 0:00:17 left",
        "80 of 100 games, 60 kept, 3 a second, 0:00:07 left",
        "100 of 100 games, 60 kept, 2.67 a second, 0:00:00 left",
    ]
    assert lines(monkeypatch, terminal=False).splitlines() == said
    assert lines(monkeypatch, terminal=True, TERM="dumb").splitlines() == said
