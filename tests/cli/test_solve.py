"""`guidance solve`: one state on the command line, or a file of them."""

import gzip
import json
import stat

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import csv, parquet
from typer.testing import CliRunner

from guidance.cli.program import app
from guidance.errors import ConfigError, OutputError
from guidance.game import Ball, Cylinder, Game, Reason, StandOff, Winner, solve
from guidance.sweeps import states as state_files

PAPER = ["--pursuer", "8,1.42,9.41", "--evader", "7.92,9.6", "--speed-ratio", "2"]
PLACES = ["pursuer_x_m", "pursuer_y_m", "pursuer_z_m", "evader_x_m", "evader_y_m"]
TARGET = ["target_x_m", "target_y_m"]


def run(*arguments):
    result = CliRunner().invoke(app, ["solve", *map(str, arguments)])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.output


def table(count, seed=0, *, target=True):
    rng = np.random.default_rng(seed)
    return pa.table(
        {name: rng.uniform(1.0, 30.0, count) for name in PLACES + (TARGET if target else [])}
    )


def read(path):
    return csv.read_csv(path) if path.suffix == ".csv" else parquet.read_table(path)


def test_one_state_is_answered_in_json():
    answer = json.loads(run(*PAPER, "--json"))
    expected = solve(Game(Ball(2.0), 1.0), np.array([8, 1.42, 9.41]), np.array([7.92, 9.6, 0]))
    assert answer["winner"] == "pursuer"
    assert answer["reason"] == "solved"
    assert answer["value"] == float(expected.value)
    assert answer["margin_s"] is None
    assert answer["meeting_point_m"] == expected.meeting_point_m.tolist()
    assert answer["pursuer_velocity_m_s"] == expected.pursuer_velocity_m_s.tolist()


def test_one_state_is_answered_for_people():
    output = run(*PAPER)
    for said in ("pursuer", "10.4247", "7.8181, 20.0242, 0.0000", "none: without a target"):
        assert said in output
    escape = run("--pursuer", "9,9,9", "--evader", "-1,1", "--target", "0,0", "--speed-ratio", "2")
    assert "evader" in escape
    assert "short of a capture" in escape
    caught = run("--pursuer", "9,9,9", "--evader", "10,1", "--target", "0,0", "--speed-ratio", "2")
    assert "final distance to the target" in caught


def test_every_option_reaches_the_game():
    output = run(
        "--pursuer", "40,0,30", "--evader", "30,2", "--target", "0,0", "--cylinder", "12,3,1.5", "--evader-speed", "3",
        "--standoff", "3,5", "--json",
    )  # fmt: skip
    game = Game(Cylinder(12.0, 3.0, 1.5), 3.0, standoff=StandOff(3.0, 5.0))
    expected = solve(game, np.array([40.0, 0.0, 30.0]), np.array([30.0, 2.0, 0.0]), np.zeros(3))
    assert json.loads(output)["value"] == float(expected.value)


@pytest.mark.parametrize("kind", ["csv", "parquet"])
@pytest.mark.parametrize("chunk", [7, 65536])
def test_a_file_of_states_is_answered_row_by_row(tmp_path, kind, chunk, monkeypatch):
    monkeypatch.setattr(state_files, "ROWS_AT_ONCE", chunk)
    states = tmp_path / f"states.{kind}"
    out = tmp_path / "deep" / f"answers.{kind}"
    given = table(50)
    csv.write_csv(given, states) if kind == "csv" else parquet.write_table(given, states)
    run("--states", states, "--out", out, "--speed-ratio", "2")
    answers = read(out)
    assert answers.column_names[:7] == PLACES + TARGET
    columns = [given.column(name).to_numpy() for name in PLACES + TARGET]
    P, E, T = np.zeros((3, 50, 3))
    P[:] = np.stack(columns[:3], 1)
    E[:, :2] = np.stack(columns[3:5], 1)
    T[:, :2] = np.stack(columns[5:], 1)
    expected = solve(Game(Ball(2.0), 1.0), P, E, T)
    np.testing.assert_allclose(answers.column("value").to_numpy(), expected.value, rtol=1e-12)
    np.testing.assert_allclose(
        answers.column("pursuer_velocity_z_m_s").to_numpy(), expected.pursuer_velocity_m_s[:, 2]
    )
    np.testing.assert_allclose(
        answers.column("meeting_point_y_m").to_numpy(), expected.meeting_point_m[:, 1]
    )
    assert answers.column("winner").to_pylist() == [Winner(code).word for code in expected.winner]


def test_a_row_may_have_its_own_speed_ratio_and_its_own_fault(tmp_path):
    states = tmp_path / "states.csv"
    out = tmp_path / "answers.parquet"
    rows = ["8,1,9,7,9,2,a", "8,1,9,,9,2,b", "8,1,9,7,9,0.9,c", "8,1,9,7,9,-1,d", "8,1,9,7,9,3,e"]
    states.write_text("\n".join([",".join([*PLACES, "speed_ratio", "note"]), *rows]) + "\n")
    run("--states", states, "--out", out, "--evader-speed", "2")
    answers = read(out)
    assert answers.column("note").to_pylist() == list("abcde")
    assert answers.column("reason").to_pylist() == [
        Reason.SOLVED.word, Reason.NOT_FINITE.word, Reason.PURSUER_TOO_SLOW.word, Reason.OUT_OF_RANGE.word, "solved",
    ]  # fmt: skip
    value = answers.column("value").to_numpy()
    assert np.isnan(value).tolist() == [False, True, True, True, False]
    single = solve(Game(Ball(6.0), 2.0), np.array([8.0, 1.0, 9.0]), np.array([7.0, 9.0, 0.0]))
    assert value[4] == pytest.approx(float(single.value))


@pytest.mark.parametrize("kind", ["csv", "parquet"])
@pytest.mark.parametrize("chunk", [2, 65536])
def test_a_cell_without_a_number_costs_its_own_row_and_is_named(tmp_path, kind, chunk, monkeypatch):
    monkeypatch.setattr(state_files, "ROWS_AT_ONCE", chunk)
    states = tmp_path / f"states.{kind}"
    out = tmp_path / f"answers.{kind}"
    rows = [
        ["8", "1", "9", "7", "9", "a"],
        ["8", "1", "nine", "7", "9", "b"],
        ["8", " 1.0 ", "9e0", "7", "9", "c"],
        ["8", "1", "9", None, "9", "d"],
        ["x", "1", "9", "y", "9", "e"],
        ["1e200", "1", "9", "7", "9", "f"],
    ]
    names = [*PLACES, "note"]
    if kind == "csv":
        lines = [
            ",".join(names),
            *(",".join("" if cell is None else cell for cell in row) for row in rows),
        ]
        states.write_text("\n".join(lines) + "\n")
    else:
        columns = zip(*rows, strict=True)
        parquet.write_table(
            pa.table({name: list(column) for name, column in zip(names, columns, strict=True)}),
            states,
        )
    result = CliRunner().invoke(
        app, ["solve", "--states", str(states), "--out", str(out), "--speed-ratio", "2"]
    )
    assert result.exit_code == 0, result.output
    said = " ".join(result.stderr.split())
    assert "2 of 6 rows have no answer" in said
    assert "row 2, pursuer_z_m = 'nine'; row 5, evader_x_m = 'y'; row 5, pursuer_x_m = 'x'" in said
    answers = read(out)
    assert answers.column("note").to_pylist() == list("abcdef")
    assert answers.column("reason").to_pylist() == [
        "solved", "not_a_number", "solved", "not_finite", "not_a_number", "overflow",
    ]  # fmt: skip
    value = answers.column("value").to_numpy()
    assert np.isnan(value).tolist() == [False, True, False, True, True, True]
    assert value[2] == value[0]
    assert answers.column("pursuer_z_m").to_pylist()[:3] == [9.0, None, 9.0]


def test_many_cells_without_a_number_are_counted(tmp_path):
    states = tmp_path / "states.csv"
    out = tmp_path / "answers.csv"
    states.write_text(
        "\n".join([",".join(PLACES), *(f"1,2,3,4,word{index}" for index in range(9))]) + "\n"
    )
    result = CliRunner().invoke(
        app, ["solve", "--states", str(states), "--out", str(out), "--speed-ratio", "2"]
    )
    said = " ".join(result.stderr.split())
    assert "9 of 9 rows have no answer" in said
    assert "row 5, evader_y_m = 'word4'; and 4 more" in said


def test_answers_solved_again_replace_the_old_ones(tmp_path):
    first, second, third = (tmp_path / f"{name}.parquet" for name in "abc")
    parquet.write_table(table(5, target=False), first)
    run("--states", first, "--out", second, "--speed-ratio", "2")
    run("--states", second, "--out", third, "--speed-ratio", "4")
    assert read(third).column_names == read(second).column_names
    assert (read(third).column("value").to_numpy() < read(second).column("value").to_numpy()).all()


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_answers_are_private_and_not_written_through_a_symbolic_link(tmp_path, kind):
    states = tmp_path / "states.parquet"
    parquet.write_table(table(5, target=False), states)
    out = tmp_path / f"answers.{kind}"
    run("--states", states, "--out", out, "--speed-ratio", "2")
    assert stat.S_IMODE(out.stat().st_mode) == 0o600
    link = tmp_path / f"link.{kind}"
    link.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OutputError, match="symbolic links"):
        run("--states", states, "--out", link, "--speed-ratio", "2")
    assert not (tmp_path / "elsewhere").exists()


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_a_file_without_rows_has_answers_without_rows(tmp_path, kind):
    states = tmp_path / f"none.{kind}"
    out = tmp_path / "answers.csv"
    empty = table(0)
    csv.write_csv(empty, states) if kind == "csv" else parquet.write_table(empty, states)
    run("--states", states, "--out", out, "--speed-ratio", "2")
    assert "meeting_point_x_m" in out.read_text()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (
            ["--pursuer", "1,2", "--evader", "1,2", "--speed-ratio", "2"],
            "--pursuer = '1,2': must be 3 finite numbers",
        ),
        (
            ["--pursuer", "1,2,nan", "--evader", "1,2", "--speed-ratio", "2"],
            "--pursuer = '1,2,nan'",
        ),
        (["--pursuer", "1,2,3", "--evader", "a,b", "--speed-ratio", "2"], "--evader = 'a,b'"),
        (["--pursuer", "1,2,3", "--speed-ratio", "2"], "--pursuer, --evader: both must be given"),
        ([*PAPER[:-1], "1"], "--speed-ratio = 1.0: must be a finite number above 1"),
        ([*PAPER[:-1], "nan"], "--speed-ratio = nan"),
        (PAPER[:-2], "exactly one of them must be given"),
        ([*PAPER, "--cylinder", "3,1,1"], "exactly one of them must be given"),
        ([*PAPER, "--evader-speed", "-1"], "--evader-speed = -1.0: must be"),
        ([*PAPER, "--standoff", "3"], "--standoff = '3': must be 2 finite numbers"),
    ],
)
def test_a_wrong_argument_is_named_with_what_is_allowed(arguments, said):
    with pytest.raises(ConfigError) as error:
        run(*arguments)
    assert said in str(error.value)


def test_wrong_files_and_columns_are_named(tmp_path):
    states = tmp_path / "states.csv"
    out = tmp_path / "answers.csv"
    csv.write_csv(table(3), states)
    ratio = tmp_path / "ratio.parquet"
    parquet.write_table(table(3).append_column("speed_ratio", pa.array([2.0, 2.0, 2.0])), ratio)
    short = tmp_path / "short.csv"
    csv.write_csv(table(3).drop_columns(["target_y_m"]), short)
    ragged = tmp_path / "ragged.csv"
    ragged.write_text(",".join(PLACES) + "\n1,2,3,4,5\n1,2,3,4\n")
    lists = tmp_path / "lists.parquet"
    parquet.write_table(pa.table({name: [[1.0]] for name in PLACES}), lists)
    own = tmp_path / "own.csv"
    csv.write_csv(table(3).append_column("value", pa.array([1.0, 2.0, 3.0])), own)
    twice = tmp_path / "twice.csv"
    twice.write_text(",".join((*PLACES, "note", "note")) + "\n1,2,3,4,5,a,b\n")
    again = tmp_path / "again.parquet"
    parquet.write_table(pa.table([[1.0]] * 2, names=["note", "note"]), again)
    latin = tmp_path / "latin.csv"
    latin.write_bytes((",".join((*PLACES, "fl\xfcge")) + "\n1,2,3,4,5,6\n").encode("latin-1"))
    packed = tmp_path / "packed.csv"
    packed.write_bytes(gzip.compress(states.read_bytes()))
    given = ["--speed-ratio", "2"]
    for arguments, said in (
        (["--states", twice, "--out", out, *given], "twice.csv: the column note is there twice"),
        (
            ["--states", again, "--out", out, *given],
            "again.parquet: the column note is there twice",
        ),
        (
            ["--states", latin, "--out", out, *given],
            "its first line is not UTF-8: save it as UTF-8",
        ),
        (["--states", packed, "--out", out, *given], "is compressed with gzip: unpack it"),
        (["--states", tmp_path / "no.csv", "--out", out, *given], "must be an existing file"),
        (
            ["--states", tmp_path, "--out", out, *given],
            "must be an existing file that ends in .csv or .parquet",
        ),
        (["--states", states, *given], "--out: missing; it names the file for the answers"),
        (
            ["--states", states, "--out", tmp_path / "out.txt", *given],
            "out.txt: must end in .csv or .parquet",
        ),
        (["--states", states, "--out", states, *given], "must not be the file of the states"),
        (["--states", states, "--out", out], "has no column speed_ratio"),
        (["--states", ratio, "--out", out, *given], "has the column speed_ratio"),
        (["--states", ratio, "--out", out, "--cylinder", "3,1,1"], "has the column speed_ratio"),
        (["--states", short, "--out", out, *given], "the column target_y_m is missing"),
        (["--states", ragged, "--out", out, *given], "cannot be read: CSV parse error: "),
        (["--states", ragged, "--out", out, *given], "Expected 5 columns, got 4"),
        (["--states", lists, "--out", out, *given], "pursuer_x_m holds list"),
        (["--states", own, "--out", out, *given], "the column value has the name of an answer"),
    ):
        with pytest.raises(ConfigError) as error:
            run(*arguments)
        assert said in str(error.value)
