import json
import math

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet
from scipy import stats
from typer.testing import CliRunner

from guidance.cli.sweep import sweep as app
from guidance.sim.maths import play
from guidance.sim.scenario_file import load_scenario
from guidance.sweeps.drawing import key_label
from guidance.sweeps.report import write_report
from guidance.sweeps.tally import QUANTILES, bins_of, tallied


def rows_of(folder):
    return pa.concat_tables([parquet.read_table(part) for part in folder.parts]).to_pandas()


def test_the_tally_is_that_of_all_rows_at_once(mixed):
    everything = rows_of(mixed)
    assert {"captured", "time_up", "invalid"} <= set(everything["end"])
    for tally in tallied(mixed, worst=2):
        rows = everything[
            (everything.pursuer_policy == tally.pair.pursuer) & (everything.evader_policy == tally.pair.evader)
        ]
        assert dict(tally.ends) == rows["end"].value_counts().to_dict()
        known = rows["regret"].dropna()
        assert tally.regret.mean == pytest.approx(known.mean())
        assert tally.quantiles() == pytest.approx(known.quantile(list(QUANTILES)).tolist())
        for bins, games, captures in zip(tally.bins, tally.games, tally.captures, strict=True):
            assert games.sum() == (rows["end"] != "invalid").sum()
            assert captures.sum() == (rows["end"] == "captured").sum()
            if bins.values:
                for value, count in zip(bins.values, captures, strict=True):
                    assert count == ((rows[bins.column] == value) & (rows["end"] == "captured")).sum()


def test_the_worst_are_those_lost_against_the_prediction_and_then_by_regret(mixed):
    everything = rows_of(mixed).set_index("row")
    for tally in tallied(mixed, worst=1000):
        ends = [bad.end for bad in tally.ranked]
        assert "invalid" not in ends
        lost = ends.count("time_up")
        assert ends == ["time_up"] * lost + ["captured"] * (len(ends) - lost)
        distance = [everything.loc[bad.row, "final_distance_m"] for bad in tally.ranked[:lost]]
        regret = [bad.regret for bad in tally.ranked[lost:]]
        assert distance == sorted(distance, reverse=True)
        assert regret == sorted(regret, reverse=True)
        assert [bad.row for bad in tallied_one(mixed, tally.pair, 3).ranked] == [bad.row for bad in tally.ranked[:3]]


def tallied_one(folder, pair, worst):
    return next(tally for tally in tallied(folder, worst=worst) if tally.pair == pair)


def test_a_worst_case_is_a_scenario_file_that_gives_its_row_again(mixed, tmp_path):
    write_report(mixed.path, tmp_path / "report", worst=2)
    summary = json.loads((tmp_path / "report" / "report.json").read_text())
    everything = rows_of(mixed).set_index("row")
    assert len(summary["worst"]) == 8
    for case in summary["worst"]:
        _, scenario = load_scenario(str(tmp_path / "report" / case["file"]))
        outcome = play([scenario])[0]._asdict()
        row = everything.loc[case["row"]]
        for name, value in outcome.items():
            if isinstance(value, float):
                assert value == row[name] or (math.isnan(value) and math.isnan(row[name]))
            elif not isinstance(value, tuple):
                assert value == row[name]


def test_the_report_says_its_intervals_and_writes_pictures_twice(mixed):
    done = CliRunner().invoke(app, ["report", str(mixed.path), "--worst", "1"])
    assert done.exit_code == 0
    assert "192 of 192 rows, as maths; regret in s" in done.stdout
    out = mixed.path / "report"
    for name in ("regret", "capture", "worst"):
        assert (out / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert (out / f"{name}.pdf").read_bytes().startswith(b"%PDF")
    summary = json.loads((out / "report.json").read_text())
    pair = summary["policies"][0]
    expected = stats.binomtest(pair["ends"]["captured"], pair["games"]).proportion_ci(method="wilson")
    assert (pair["capture"]["low"], pair["capture"]["high"]) == pytest.approx((expected.low, expected.high))
    known = rows_of(mixed).query("pursuer_policy == 'optimal' and evader_policy == 'optimal'")["regret"].dropna()
    low, high = stats.t.interval(0.95, len(known) - 1, known.mean(), stats.sem(known))
    assert (pair["regret_mean"]["low"], pair["regret_mean"]["high"]) == pytest.approx((low, high))


def test_a_sweep_that_is_not_complete_is_reported_as_far_as_it_is(mixed, tmp_path):
    for part in mixed.parts[1:]:
        part.unlink()
    write_report(mixed.path, tmp_path / "report", worst=0)
    summary = json.loads((tmp_path / "report" / "report.json").read_text())
    assert (summary["rows"], summary["rows_planned"]) == (64, 192)
    assert not (tmp_path / "report" / "worst.png").exists()


def test_a_folder_without_rows_says_so(mixed, tmp_path):
    for part in mixed.parts:
        part.unlink()
    done = CliRunner().invoke(app, ["report", str(mixed.path)])
    assert "no row of this sweep has been written yet" in str(done.exception)
    done = CliRunner().invoke(app, ["report", str(tmp_path)])
    assert "is no sweep's folder" in str(done.exception)


def test_bins_cover_all_that_is_drawn(mixed):
    for axis in mixed.plan.axes[2:]:
        drawn = axis.distribution.draw(np.arange(500), axis.stream)
        for bins, cells in zip(bins_of(axis), axis.cells(drawn), strict=True):
            places = bins.places(pa.chunked_array([cells]))
            assert (places >= 0).all()
            assert (places < len(bins.labels)).all()


@pytest.mark.parametrize(
    ("column", "label"),
    [
        ("evader.speed_m_s", "evader speed, m/s"),
        ("pursuer.position_m[2]", "pursuer position z, m"),
        ("wind.velocity_m_s[0]", "wind velocity x, m/s"),
        ("sensor.rate_hz", "sensor rate, Hz"),
        ("sensor.dropout", "sensor dropout"),
    ],
)
def test_axes_carry_their_units(column, label):
    assert key_label(column) == label
