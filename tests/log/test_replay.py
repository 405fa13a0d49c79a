import json
import math
from functools import partial

import pytest
from typer.testing import CliRunner

from guidance.cli.program import app
from guidance.errors import ConfigError
from guidance.log import compare, cycles_of, metadata_of, replay, scan, title_of
from guidance.log.entries import BEGUN, CYCLE, EVENT
from guidance.log.replay import difference_of
from guidance.log.writer import Recorder
from guidance.session.flight_files import changes_of, recorded_settings


def rewritten(path, out, change=lambda number, row: row, repeat=1, cycles=None):
    """Copy the first cycles of a record, all by default, each passed through `change`.

    A repeated flight begins with the daemon's event.
    """
    recorder = Recorder(out, metadata_of(path))
    rows = [json.loads(item.data) for item in scan(path) if item.topic == CYCLE.topic][:cycles]
    for _ in range(repeat):
        recorder.event(0.0, BEGUN)
        for number, row in enumerate(rows):
            recorder.cycle(CYCLE.decode(json.dumps(change(number, row))))
    recorder.close()
    return out


def into_the_game(flight):
    """Return the number of cycles until two seconds after the engagement."""
    return [row.state for row in cycles_of(flight[1])].index("engaged") + 100


@pytest.fixture(scope="module")
def begun(flight, tmp_path_factory):
    """The same record until two seconds after the engagement: as much of it as most tests need."""
    path = tmp_path_factory.mktemp("begun") / "record.mcap"
    return rewritten(flight[1], path, cycles=into_the_game(flight))


def test_a_flight_is_replayed_bit_for_bit(flight):
    """Catches a decision that depends on anything but the recorded inputs."""
    result, path = flight
    comparison, survey = compare(path, recorded_settings)
    assert (comparison.cycles, comparison.setpoints) == (result.cycles, result.setpoints_sent)
    assert comparison.differing == 0
    assert comparison.first is None
    assert comparison.commanded.cycles == result.setpoints_sent
    assert comparison.commanded.speed_max_m_s == 0.0
    assert survey.torn is None


def test_the_replay_reproduces_the_game_and_the_alarms(flight):
    """Catches certificates and alarms that differ while the setpoints agree."""
    for step in replay(flight[1], recorded_settings):
        recorded = step.row.certificate
        if recorded is not None:
            # Infinity is recorded as null, like NaN.
            assert recorded.pursuer_game_m == step.outputs.certificate.pursuer_game_m
            assert recorded.value == step.outputs.certificate.value
        assert step.row.alarm == step.outputs.alarm


def test_a_nanometre_in_one_input_is_found(begun, tmp_path):
    """Catches a comparison that rounds."""
    flown = list(cycles_of(begun))
    chosen = next(number for number, row in enumerate(flown) if row.state == "engaged") + 50

    def nudge(number, row):
        if number == chosen:
            local = next(one for one in row["inputs"]["messages"] if one["kind"] == "LocalPosition")
            local["position_ned_m"][0] += 1e-9
        return row

    comparison, _ = compare(rewritten(begun, tmp_path / "nudged.mcap", nudge), recorded_settings)
    assert comparison.differing > 0
    assert comparison.first.row.now_s == flown[chosen].now_s
    assert comparison.first.differing == ("setpoint",)


def test_a_record_without_the_cause_of_a_state_is_replayed_without_a_difference(begun, tmp_path):
    """Catches a replay that refuses records of an older version."""

    def without_cause(number, row):
        return {name: value for name, value in row.items() if name != "by"}

    path = rewritten(begun, tmp_path / "older.mcap", without_cause)
    assert all(row.by is None for row in cycles_of(path))
    assert compare(path, recorded_settings)[0].differing == 0


def test_minus_zero_is_not_zero(begun, tmp_path):
    """Catches a comparison by value instead of by bits."""
    negated = []

    def negate(number, row):
        for params in (
            request["params"]
            for request in row.get("requests", ())
            if 0.0 in request.get("params", ())
        ):
            params[params.index(0.0)] = -0.0
            negated.append(number)
        return row

    path = rewritten(begun, tmp_path / "zero.mcap", negate)
    comparison, _ = compare(path, recorded_settings)
    assert negated
    assert comparison.differing == len(set(negated))
    assert comparison.first.differing == ("requests",)


def test_another_setting_gives_other_commands_for_the_recorded_motion(begun):
    # The evader runs straight away, so a vehicle with its own climb and descent flies the same by every policy.
    """Catches a what-if that flies its own motion or the old settings."""
    pursuit = partial(
        recorded_settings, changes={"policy": "pure_pursuit", "pursuer.speed_m_s": 2.0}
    )
    assert pursuit(metadata_of(begun)).cycle.policy.name == "pure_pursuit"
    comparison, _ = compare(begun, pursuit, what_if=True)
    assert comparison.differing > 90
    assert comparison.wanted.speed_max_m_s > 0.1
    for step in replay(begun, pursuit, what_if=True):
        assert str(step.outputs.state) == step.row.state
        certificate = step.outputs.certificate
        if step.row.state == "engaged" and certificate is not None:
            assert certificate.pursuer_game_m == step.row.certificate.pursuer_game_m


def test_the_same_policy_as_a_what_if_gives_the_same_commands(begun):
    """Catches a what-if that differs by its own doing."""
    same = partial(recorded_settings, changes={"policy": "optimal"})
    comparison, _ = compare(begun, same, what_if=True)
    assert comparison.commanded.cycles > 90
    assert comparison.commanded.speed_max_m_s == 0.0
    assert comparison.wanted.angle_max_rad == 0.0


def test_a_second_flight_is_replayed_without_the_state_of_the_first(begun, tmp_path):
    """Catches memory that a flight takes into the next one."""
    path = rewritten(begun, tmp_path / "twice.mcap", repeat=2)
    comparison, _ = compare(path, recorded_settings)
    assert comparison.cycles == 2 * len(list(cycles_of(begun)))
    assert comparison.differing == 0


def test_angles_are_correct_and_zero_for_a_zero_vector():
    across = ((1.0, 0.0, 0.0), (0.0, 0.0, -2.0))
    back = ((1.0, 1.0, 0.0), (-1.0, -1.0, 0.0))
    assert difference_of([across]).angle_max_rad == pytest.approx(math.pi / 2.0)
    assert difference_of([back]).angle_max_rad == pytest.approx(math.pi)
    assert difference_of([((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))]) == (1, 0.0, 0.0, 1.0, 1.0)
    unknown = ((math.nan,) * 3, (1.0, 0.0, 0.0))
    both = difference_of([across, unknown, back])
    assert (both.cycles, both.angle_sum_rad) == (2, pytest.approx(1.5 * math.pi))
    assert both.speed_sum_m_s == pytest.approx(math.sqrt(5.0) + math.sqrt(8.0))
    assert difference_of([]) == (0, 0.0, 0.0, 0.0, 0.0)


def test_changes_are_read_as_toml_and_wrong_ones_are_refused():
    assert changes_of(["policy=hold", "pursuer.speed_m_s = 4.0"]) == {
        "policy": "hold",
        "pursuer.speed_m_s": 4.0,
    }
    assert changes_of(["target.position_m=[1, 2]"]) == {"target.position_m": [1, 2]}
    with pytest.raises(ConfigError, match=r"--with policy: must be KEY=VALUE"):
        changes_of(["policy"])


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"policy": "swerve"}, "allowed are optimal"),
        ({"pursuer.speed": 4.0}, "pursuer.speed: unknown key; did you mean"),
        ({"pursuer.speed_m_s": 400.0}, "pursuer.speed_m_s = 400"),
        ({"title.text": 1}, "title is not a section"),
    ],
)
def test_settings_that_do_not_exist_are_refused(flight, change, what):
    with pytest.raises(ConfigError, match=what):
        recorded_settings(metadata_of(flight[1]), change)


def test_a_record_without_settings_cannot_be_replayed():
    with pytest.raises(ConfigError, match="no scenario and no config, only seed"):
        recorded_settings({"seed": "1"})
    assert title_of({"seed": "1"}) == "flight"


def test_the_command_shows_the_first_difference_and_exits_with_1(begun, tmp_path):
    """Catches a replay that differs and ends with 0."""
    shifted = []

    def shift(number, row):
        if "setpoint" in row:
            row["setpoint"]["velocity_ned_m_s"][1] += 0.25
            shifted.append(number)
        return row

    path = rewritten(begun, tmp_path / "shifted.mcap", shift)
    run = CliRunner().invoke(app, ["replay", str(path)])
    assert run.exit_code == 1
    assert f"{len(shifted)} cycles differ" in run.output
    assert "recorded" in run.output
    assert '"kind": "LocalPosition"' in run.output


def test_the_command_says_how_far_apart_another_policy_is(begun):
    """Catches a what-if that the command counts as a failed replay."""
    run = CliRunner().invoke(app, ["replay", str(begun), "--with", "policy=pure_pursuit"])
    assert run.exit_code == 0, run.output
    assert "wanted by the policy over" in run.output


def test_a_torn_record_is_replayed_up_to_the_damage(flight, tmp_path):
    """Catches a replay that refuses the record of a crash."""
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(flight[1].read_bytes()[:400_000])
    run = CliRunner().invoke(app, ["replay", str(torn)])
    assert run.exit_code == 0, run.output
    assert "bit for bit" in run.output
    assert "the record is not whole: torn" in run.output
    assert EVENT.topic in {item.topic for item in scan(torn)}


def test_a_replay_that_compares_nothing_is_no_success(flight, tmp_path):
    """Catches a replay that compared nothing and ends with 0."""
    empty = tmp_path / "empty.mcap"
    Recorder(empty, metadata_of(flight[1])).close()
    refused = CliRunner().invoke(app, ["replay", str(empty)])
    assert "nothing was replayed" in str(refused.exception)
    silent = tmp_path / "silent.mcap"
    recorder = Recorder(silent, metadata_of(flight[1]))
    for row in cycles_of(flight[1]):
        if row.setpoint is not None:
            break
        recorder.cycle(row)
    recorder.close()
    run = CliRunner().invoke(app, ["replay", str(silent)])
    assert run.exit_code == 1
    assert "no setpoint was recorded" in run.output
