"""`guidance solve` on a file of teams."""

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import csv, parquet
from typer.testing import CliRunner

from guidance.cli.program import app
from guidance.errors import ConfigError
from guidance.game import Ball, Game, Reason, Winner
from guidance.game.team import match_teams


def run(*arguments):
    result = CliRunner().invoke(app, ["solve", *map(str, arguments)])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == 0, result.output


def read(path):
    return csv.read_csv(path) if path.suffix == ".csv" else parquet.read_table(path)


def positions(rows, n, m, seed=0):
    rng = np.random.default_rng(seed)
    P = rng.uniform(-25.0, 25.0, (rows, n, 3))
    E = rng.uniform(-18.0, 18.0, (rows, m, 3))
    P[..., 2] = np.abs(P[..., 2])
    E[..., 2] = 0.0
    return P, E


def columns(P, E, *, target=True):
    named = {
        f"pursuer_{i}_{axis}_m": P[:, i, k]
        for i in range(P.shape[1])
        for k, axis in enumerate("xyz")
    }
    named |= {
        f"evader_{j}_{axis}_m": E[:, j, k] for j in range(E.shape[1]) for k, axis in enumerate("xy")
    }
    if target:
        named |= {"target_x_m": np.full(len(P), 1.0), "target_y_m": np.full(len(P), 2.0)}
    return pa.table({"name": [f"row {i}" for i in range(len(P))], **named})


def write(table, path):
    (csv.write_csv if path.suffix == ".csv" else parquet.write_table)(table, path)
    return path


@pytest.mark.parametrize("kind", ["csv", "parquet"])
@pytest.mark.parametrize("tad", [True, False])
def test_every_row_is_a_game_of_teams(tmp_path, kind, tad):
    P, E = positions(9, 3, 2)
    states = write(columns(P, E, target=tad), tmp_path / f"a.{kind}")
    out = tmp_path / f"b.{kind}"
    run("--states", states, "--out", out, "--speed-ratio", 2)
    answers = read(out)
    known = match_teams(Game(Ball(2.0), 1.0), P, E, np.array([1.0, 2.0, 0.0]) if tad else None)
    assert answers["name"].to_pylist() == [f"row {i}" for i in range(9)]
    assert answers["guaranteed"].to_pylist() == known.guaranteed.tolist()
    np.testing.assert_allclose(answers["total"], known.total, rtol=1e-12)
    for i in range(3):
        assert answers[f"pursuer_{i}_evader"].to_pylist() == known.evader_of[:, i].tolist()
        for k, axis in enumerate("xyz"):
            np.testing.assert_allclose(
                answers[f"pursuer_{i}_velocity_{axis}_m_s"], known.pursuer_velocity_m_s[:, i, k]
            )
    for j in range(2):
        for name in ("first", "second"):
            assert answers[f"evader_{j}_{name}"].to_pylist() == getattr(known, name)[:, j].tolist()
        for name in ("value", "lower_bound"):
            np.testing.assert_allclose(answers[f"evader_{j}_{name}"], getattr(known, name)[:, j])
        assert answers[f"evader_{j}_winner"].to_pylist() == [
            Winner(code).word for code in known.winner[:, j]
        ]
        assert answers[f"evader_{j}_reason"].to_pylist() == [
            Reason(code).word for code in known.reason[:, j]
        ]
        for k, axis in enumerate("xy"):
            np.testing.assert_allclose(
                answers[f"evader_{j}_meeting_point_{axis}_m"], known.meeting_point_m[:, j, k]
            )
            np.testing.assert_allclose(
                answers[f"evader_{j}_velocity_{axis}_m_s"], known.evader_velocity_m_s[:, j, k]
            )


def test_rows_may_have_teams_of_different_sizes_and_speed_ratios_of_their_own(tmp_path):
    P, E = positions(4, 3, 2)
    P[1, 0] = E[2, 1] = np.nan
    P[3] = np.nan
    ratio = np.array([2.0, 1.5, 3.0, 2.0])
    table = columns(P, E).append_column("speed_ratio", pa.array(ratio))
    run(
        "--states",
        write(table, tmp_path / "a.csv"),
        "--out",
        tmp_path / "b.csv",
        "--evader-speed",
        2,
    )
    answers = read(tmp_path / "b.csv")
    target = np.array([1.0, 2.0, 0.0])
    fewer = match_teams(Game(Ball(3.0), 2.0), P[1, 1:], E[1], target)
    back = np.array([1, 2, -1])
    assert [answers[f"evader_{j}_first"][1].as_py() for j in (0, 1)] == back[fewer.first].tolist()
    assert answers["pursuer_0_evader"][1].as_py() == -1
    assert answers["guaranteed"][1].as_py() == fewer.guaranteed
    alone = match_teams(Game(Ball(6.0), 2.0), P[2], E[2, :1], target)
    assert answers["evader_0_value"][2].as_py() == pytest.approx(float(alone.value[0]))
    assert [answers[f"pursuer_{i}_evader"][2].as_py() for i in range(3)] == alone.evader_of.tolist()
    assert answers["evader_1_winner"][2].as_py() == "undecided"
    assert answers["guaranteed"][3].as_py() == 0
    assert answers["evader_0_reason"][3].as_py() == "not_finite"


def test_a_place_without_all_its_numbers_has_no_answer(tmp_path):
    P, E = positions(2, 2, 1)
    P[0, 1, 2] = np.nan
    run(
        "--states",
        write(columns(P, E), tmp_path / "a.parquet"),
        "--out",
        tmp_path / "b.parquet",
        "--speed-ratio",
        2,
    )
    answers = read(tmp_path / "b.parquet")
    assert answers["evader_0_reason"].to_pylist() == ["not_finite", "solved"]
    assert answers["evader_0_first"][0].as_py() == -1
    assert np.isnan(answers["pursuer_0_velocity_x_m_s"][0].as_py())


def test_no_rows_have_the_columns_of_answers_all_the_same(tmp_path):
    states = write(columns(*positions(0, 2, 1)), tmp_path / "a.parquet")
    run("--states", states, "--out", tmp_path / "b.parquet", "--speed-ratio", 2)
    answers = read(tmp_path / "b.parquet")
    assert answers.num_rows == 0
    assert {"guaranteed", "pursuer_1_evader", "evader_0_reason"} <= set(answers.column_names)


@pytest.mark.parametrize(
    ("drop", "options", "said"),
    [
        ("pursuer_0_", ["--speed-ratio", 2], r"number the pursuers \[1\]; they must be 0, 1, 2"),
        ("evader_", ["--speed-ratio", 2], r"number the evaders \[\]"),
        ("pursuer_1_z", ["--speed-ratio", 2], "the column pursuer_1_z_m is missing"),
    ],
)
def test_a_file_that_is_none_of_teams_is_refused_by_what_is_wrong(tmp_path, drop, options, said):
    table = columns(*positions(2, 2, 1))
    table = table.select([name for name in table.column_names if not name.startswith(drop)])
    with pytest.raises(ConfigError, match=said):
        run(
            "--states",
            write(table, tmp_path / "a.parquet"),
            "--out",
            tmp_path / "b.parquet",
            *options,
        )


def test_a_cell_of_text_costs_its_row_and_no_other(tmp_path):
    P, E = positions(3, 2, 1)
    table = columns(P, E)
    place = table.schema.get_field_index("pursuer_1_x_m")
    table = table.set_column(
        place, "pursuer_1_x_m", pa.array([str(P[0, 1, 0]), "north", str(P[2, 1, 0])])
    )
    run(
        "--states",
        write(table, tmp_path / "a.csv"),
        "--out",
        tmp_path / "b.csv",
        "--speed-ratio",
        2,
    )
    answers = read(tmp_path / "b.csv")
    known = match_teams(Game(Ball(2.0), 1.0), P, E, np.array([1.0, 2.0, 0.0]))
    assert answers["evader_0_reason"].to_pylist() == ["solved", "not_a_number", "solved"]
    assert answers["guaranteed"].to_pylist() == [known.guaranteed[0], 0, known.guaranteed[2]]
    assert answers["evader_0_first"].to_pylist() == [known.first[0, 0], -1, known.first[2, 0]]
