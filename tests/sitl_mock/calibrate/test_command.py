"""`sitl-mock calibrate` as a user meets it: table, JSON, plot, exit codes, and errors that name column and row."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from sitl_mock.calibrate import COLUMNS, read_step_log
from sitl_mock.calibrate.command import calibrate_file
from sitl_mock.cli import app, main
from sitl_mock.errors import ConfigError

DATA = Path(__file__).parents[2] / "data"
HEADER = ",".join(COLUMNS)
RUNNER = CliRunner(env={"COLUMNS": "140"})


def write(path: Path, *rows: str, header: str = HEADER) -> Path:
    path.write_text("\n".join((header, *rows)) + "\n", encoding="utf-8")
    return path


def row(time_s: float, value: str = "0") -> str:
    return ",".join([f"{time_s:.2f}", *[value] * 9])


@pytest.fixture(name="good_rows")
def good_rows_fixture():
    return [row(0.1 * number) for number in range(20)]


@pytest.mark.parametrize(("name", "more"), [("px4", ["--dynamics-only"]), ("arducopter", [])])
def test_a_recorded_file_passes_and_prints_its_table(name, more):
    """Catches a calibration that the command judges otherwise than its parts."""
    result = RUNNER.invoke(app, ["calibrate", str(DATA / f"{name}_steps.csv"), *more])
    assert result.exit_code == 0
    for word in (
        "rise 10-90 %",
        "overshoot",
        "steady error",
        "RMS difference",
        name,
        "within the limit",
    ):
        assert word in result.output


def test_the_wrong_flavour_ends_with_one():
    """Catches a comparison that passes any response."""
    result = RUNNER.invoke(
        app,
        ["calibrate", str(DATA / "px4_steps.csv"), "--flavour", "arducopter", "--dynamics-only"],
    )
    assert result.exit_code == 1
    assert "ABOVE the limit" in result.output


def test_json_holds_every_segment_and_no_nan():
    result = RUNNER.invoke(
        app, ["calibrate", str(DATA / "px4_steps.csv"), "--json", "--dynamics-only"]
    )
    found = json.loads(
        result.output, parse_constant=lambda name: pytest.fail(f"{name} is not JSON")
    )
    assert found["flavour"] == "px4"
    assert found["passed"] is True
    assert len(found["segments"]) == 16
    assert found["segments"][0]["axes"]["N"]["command_m_s"] == 2.0
    assert found["segments"][0]["axes"]["E"]["real"]["rise_s"] is None


def test_a_plot_is_written(tmp_path):
    """Catches a plot that cannot be drawn."""
    picture = tmp_path / "plot.png"
    result = RUNNER.invoke(
        app,
        [
            "calibrate",
            str(DATA / "arducopter_steps.csv"),
            "--plot",
            str(picture),
            "--dynamics-only",
        ],
    )
    assert result.exit_code == 0
    assert picture.stat().st_size > 20_000


@pytest.mark.parametrize("place", ["plot.nonsense", "missing/plot.png"])
def test_a_plot_that_cannot_be_written_is_a_clear_error(tmp_path, good_rows, place):
    """Catches a traceback of the plot's library."""
    pytest.importorskip("matplotlib")
    with pytest.raises(ConfigError, match=r"plot .* cannot be written"):
        calibrate_file(
            write(tmp_path / "px4.csv", *good_rows), None, tmp_path / place, as_json=True,
            dynamics_only=True,
        )  # fmt: skip


def test_an_unknown_flavour_names_the_known_ones():
    with pytest.raises(ConfigError, match=r"betaflight: allowed are px4, arducopter"):
        calibrate_file(DATA / "px4_steps.csv", "betaflight", None, as_json=True)


def test_a_varying_command_is_compared_by_its_difference_alone(tmp_path):
    """Catches rise times that are made up for a sine."""
    rows = [f"{0.1 * k:.2f},{np.sin(0.1 * k):.4f},0,0,0,0,0,0,0,-20" for k in range(60)]
    words = ("calibrate", str(write(tmp_path / "sine.csv", *rows)), "--flavour", "px4")
    result = RUNNER.invoke(app, [*words, "--dynamics-only", "--json"])
    (segment,) = json.loads(result.output)["segments"]
    assert segment["varying"] is True
    assert segment["axes"]["N"]["command_m_s"] is None
    assert segment["axes"]["N"]["rms_m_s"] > 0.1
    assert "varying" in RUNNER.invoke(app, [*words, "--dynamics-only"]).output


def test_a_vehicle_at_rest_under_a_zero_command_passes(tmp_path, good_rows):
    """Catches a division by a command of zero."""
    assert calibrate_file(write(tmp_path / "px4.csv", *good_rows), None, None, as_json=True) == 0


@pytest.mark.parametrize("cell", ["", "fast", "nan", "inf", "1,5"])
def test_a_cell_that_is_not_a_number_is_named_by_row_and_column(tmp_path, good_rows, cell):
    cells = good_rows[4].split(",")
    cells[5] = f'"{cell}"'
    good_rows[4] = ",".join(cells)
    with pytest.raises(ConfigError, match=r"row 6, column vel_e_m_s: .*not a finite number"):
        read_step_log(write(tmp_path / "log.csv", *good_rows))


def test_a_short_row_is_named(tmp_path, good_rows):
    good_rows[2] = "0.2,1,1"
    with pytest.raises(ConfigError, match="row 4, column cmd_d_m_s"):
        read_step_log(write(tmp_path / "log.csv", *good_rows))


def test_a_missing_column_is_named(tmp_path, good_rows):
    with pytest.raises(ConfigError, match="lacks the column vel_d_m_s; needed are t_s"):
        read_step_log(
            write(tmp_path / "log.csv", *good_rows, header=HEADER.replace("vel_d_m_s", "climb"))
        )


@pytest.mark.parametrize("second", [0.5, 0.3])
def test_time_that_does_not_increase_is_named(tmp_path, good_rows, second):
    good_rows[5] = row(0.5)
    good_rows[6] = row(second)
    with pytest.raises(ConfigError, match=r"row 8, column t_s: .*times must increase"):
        read_step_log(write(tmp_path / "log.csv", *good_rows))


@pytest.mark.parametrize("rows", [0, 9])
def test_too_few_rows_are_counted(tmp_path, good_rows, rows):
    with pytest.raises(ConfigError, match=f"has {rows} rows of data; at least 10"):
        read_step_log(write(tmp_path / "log.csv", *good_rows[:rows]))


def test_other_columns_and_orders_are_welcome(tmp_path):
    names = [*reversed(COLUMNS), "note"]
    rows = [",".join(["9", "8", "7", "6", "5", "4", "3", "2", "1", f"{k}", "x"]) for k in range(12)]
    log = read_step_log(write(tmp_path / "log.csv", *rows, header=",".join(names)))
    assert log.command_ned_m_s[0].tolist() == [1.0, 2.0, 3.0]
    assert log.position_ned_m[0].tolist() == [7.0, 8.0, 9.0]


@pytest.mark.parametrize("content", [b"", b"\xff\xfe\x00", b"\x00" * 100, b"a,b\n1,2\n"])
def test_files_that_are_no_logs_are_clear_errors(tmp_path, content):
    path = tmp_path / "log.csv"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"log\.csv"):
        read_step_log(path)


def test_a_folder_is_not_a_log(tmp_path):
    with pytest.raises(ConfigError, match="is no regular file; give the name of a recorded file"):
        read_step_log(tmp_path)


def test_the_installed_command_ends_with_two_and_one_line_for_a_missing_file(
    tmp_path, monkeypatch, capsys
):
    """Catches a traceback of `sitl-mock calibrate`."""
    monkeypatch.setattr(sys, "argv", ["sitl-mock", "calibrate", str(tmp_path / "no.csv")])
    with pytest.raises(SystemExit) as ended:
        main()
    said = capsys.readouterr().err
    assert (ended.value.code, said.count("\n")) == (2, 1)
    assert "no.csv cannot be read" in said
