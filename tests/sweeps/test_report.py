import json
import math
from collections import Counter

import numpy as np
import pytest
from pyarrow import parquet
from scipy import stats
from typer.testing import CliRunner

from guidance.cli.sweep import sweep as app
from guidance.sim.maths import play_scenarios
from guidance.sim.scenario_file import load_scenario
from guidance.sweeps.drawing import key_label
from guidance.sweeps.folder import begin_or_continue, read_folder
from guidance.sweeps.report import QUANTILES, write_sweep_report
from guidance.sweeps.running import finish


class Rows(dict):
    """A sweep's rows: column -> array."""

    def of(self, mask):
        return Rows({name: column[mask] for name, column in self.items()})

    def known(self, name):
        return self[name][~np.isnan(self[name])]

    def at(self, row):
        return {name: column[self["row"] == row].item() for name, column in self.items()}


def rows_of(folder):
    table = parquet.read_table(folder.path / "rows")
    return Rows({name: table[name].to_numpy() for name in table.column_names})


def of_pair(everything, found):
    return everything.of(
        (everything["pursuer_policy"] == found["pursuer"])
        & (everything["evader_policy"] == found["evader"])
    )


@pytest.fixture
def report_of(tmp_path, undrawn):
    """Writes the report of a folder, without pictures, and reads it."""

    def make(folder, worst=2):
        write_sweep_report(folder.path, tmp_path / "report", worst=worst)
        return json.loads((tmp_path / "report" / "report.json").read_text())

    return make


@pytest.fixture
def swept(plan_from, tmp_path):
    """Runs a sweep of the short scenario."""

    def make(text):
        finish(
            begin_or_continue(
                tmp_path / "swept", plan_from('scenario = "short.toml"\n' + text), 64
            ),
            lambda _: None,
        )
        return read_folder(tmp_path / "swept")

    return make


def test_the_results_of_each_pair_of_policies_are_those_of_its_rows(mixed, report_of):
    """Catches statistics of a pair of policies that are taken from other rows."""
    everything = rows_of(mixed)
    assert {"captured", "time_up", "invalid"} <= set(everything["end"])
    for found in report_of(mixed)["policies"]:
        rows = of_pair(everything, found)
        assert found["ends"] == Counter(rows["end"].tolist())
        assert found["games"] == (rows["end"] != "invalid").sum()
        known = rows.known("regret")
        assert found["regret_mean"]["estimate"] == pytest.approx(known.mean())
        assert list(found["regret_quantiles"].values()) == pytest.approx(
            np.quantile(known, list(QUANTILES)).tolist()
        )


def test_groups_of_a_key_and_of_two_keys_are_those_of_their_rows(mixed, report_of):
    everything = rows_of(mixed)
    for found in report_of(mixed)["policies"]:
        rows = of_pair(everything, found)
        for column in ("evader.speed_m_s", "evader.position_m[0]"):
            assert sum(group["games"] for group in found["by_key"][column]) == found["games"]
        assert len(found["by_point"]) == 4
        for group in found["by_point"]:
            speeds, limit = group["at"].values()
            there = rows.of(
                (rows["pursuer.speed_set"] == speeds) & (rows["time_limit_s"] == float(limit))
            )
            ends = there["end"][there["end"] != "invalid"]
            assert group["games"] == len(ends)
            if len(ends):
                assert group["capture"]["estimate"] == pytest.approx((ends == "captured").mean())
            if len(known := there.known("regret")):
                assert group["regret_mean"]["estimate"] == pytest.approx(known.mean())


def test_only_random_draws_have_intervals(mixed, swept, report_of):
    group = report_of(mixed)["policies"][0]["by_point"][0]
    expected = stats.binomtest(round(group["capture"]["estimate"] * group["games"]), group["games"])
    low, high = expected.proportion_ci(method="wilson")
    assert (group["capture"]["low"], group["capture"]["high"]) == pytest.approx((low, high))
    fixed = report_of(swept('seeds = 5\n[grid]\n"evader.speed_m_s" = [1.0, 3.0]\n'))["policies"][0]
    assert {one["regret_mean"]["low"] for one in fixed["by_key"]["evader.speed_m_s"]} == {None}
    assert fixed["capture"]["low"] is None


def test_a_mean_of_random_draws_has_students_interval(swept, report_of):
    random = 'seeds = 30\n[random]\n"evader.speed_m_s" = { uniform = [1.0, 3.0] }\n'
    folder = swept(random + '[[policies]]\npursuer = "pure_pursuit"\nevader = "random_turns"\n')
    regret = report_of(folder)["policies"][0]["regret_mean"]
    numbers = rows_of(folder)["regret"]
    low, high = stats.t.interval(0.95, 29, numbers.mean(), stats.sem(numbers))
    assert (regret["low"], regret["high"]) == pytest.approx((low, high))


def test_reasons_of_invalid_rows_are_counted(mixed, report_of):
    invalid = report_of(mixed)["invalid"]
    everything = rows_of(mixed)
    assert sum(one["rows"] for one in invalid) == (everything["end"] == "invalid").sum()
    assert len(invalid) == 1
    assert "must be above 1" in invalid[0]["reason"]


def test_the_worst_rows_are_lost_games_then_those_with_the_largest_regret(mixed, report_of):
    """Catches worst cases that are not the worst."""
    everything = rows_of(mixed)
    worst = report_of(mixed, worst=1000)["worst"]
    ends = [case["end"] for case in worst]
    assert "invalid" not in ends
    lost = ends.count("time_up")
    assert ends == ["time_up"] * lost + ["captured"] * (len(ends) - lost)
    distance = [everything.at(case["row"])["distance_to_disc_m"] for case in worst[:lost]]
    regret = [case["regret"] for case in worst[lost:]]
    assert distance == sorted(distance, reverse=True)
    assert regret == sorted(regret, reverse=True)


def test_a_sweep_over_two_keys_prints_a_map_that_fits_the_terminal(swept, undrawn):
    folder = swept(
        'seeds = 2\n[grid]\n"evader.speed_m_s" = [1.0, 3.0]\n"pursuer.position_m[2]" = [6.0, 8.0, 10.0]\n'
        '[[policies]]\npursuer = "pure_pursuit"\n'
    )
    for columns in (60, 80, 120):
        done = CliRunner().invoke(app, ["report", str(folder.path)], env={"COLUMNS": str(columns)})
        said = " ".join(done.stdout.split())
        assert "mean regret by evader speed, m/s (down) and pursuer position z, m (across)" in said
        assert (
            max(len(line) for line in done.stdout.splitlines() if str(folder.path) not in line)
            <= columns
        )


def test_a_worst_case_is_a_scenario_file_that_reproduces_its_row(mixed, tmp_path, report_of):
    summary = report_of(mixed)
    everything = rows_of(mixed)
    assert len(summary["worst"]) == 8
    for case in summary["worst"]:
        _, scenario = load_scenario(str(tmp_path / "report" / case["file"]))
        outcome = play_scenarios([scenario])[0]._asdict()
        row = everything.at(case["row"])
        for name, value in outcome.items():
            if isinstance(value, float):
                assert value == row[name] or (math.isnan(value) and math.isnan(row[name]))
            elif not isinstance(value, tuple):
                assert value == row[name]


def test_pictures_are_written_as_png_and_pdf(swept):
    """Catches a picture of a sweep that cannot be drawn."""
    folder = swept(
        "seeds = 2\n"
        '[grid]\n"pursuer.speed_set" = ["ball", "cylinder"]\n"time_limit_s" = [0.6, 4.0]\n'
        '[random]\n"evader.speed_m_s" = { normal = [5.0, 1.5] }\n'
    )
    done = CliRunner().invoke(app, ["report", str(folder.path), "--worst", "1"])
    assert done.exit_code == 0
    assert "8 of 8 rows, as maths" in done.stdout
    for name in ("regret", "keys", "map"):
        assert (folder.path / "report" / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert (folder.path / "report" / f"{name}.pdf").read_bytes().startswith(b"%PDF")


def test_an_incomplete_sweep_has_a_report_of_its_rows(mixed, report_of):
    for part in mixed.parts[1:]:
        part.unlink()
    incomplete = report_of(mixed, worst=0)
    assert (incomplete["rows"], incomplete["rows_planned"]) == (32, 96)
    assert incomplete["worst"] == []


def test_a_folder_without_rows_is_refused(mixed, tmp_path):
    for part in mixed.parts:
        part.unlink()
    done = CliRunner().invoke(app, ["report", str(mixed.path)])
    assert "this sweep has no rows yet" in str(done.exception)
    done = CliRunner().invoke(app, ["report", str(tmp_path)])
    assert "not the folder of a sweep" in str(done.exception)


@pytest.mark.parametrize(
    ("column", "label"),
    [
        ("evader.speed_m_s", "evader speed, m/s"),
        ("pursuer.position_m[2]", "pursuer position z, m"),
        ("wind.velocity_m_s[0]", "wind velocity x, m/s"),
        ("sensor.rate_hz", "sensor rate, Hz"),
        ("sensor.dropout", "sensor dropout"),
        ("evader[0].speed_m_s", "evader[0] speed, m/s"),
        ("pursuer[1].position_m[2]", "pursuer[1] position z, m"),
    ],
)
def test_the_label_of_an_axis_has_its_unit(column, label):
    assert key_label(column) == label
