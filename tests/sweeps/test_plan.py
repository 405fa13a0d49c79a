import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from guidance.errors import ConfigError
from guidance.sim.scenario import Scenario
from guidance.sweeps.axes import Axis, Distribution, path_of
from guidance.sweeps.plan import plan_of_manifest
from guidance.sweeps.rows import planned, scenarios_of, table_of_rows

HEAD = 'scenario = "short.toml"\n'


def refused(plan_from, text):
    with pytest.raises(ConfigError) as caught:
        plan_from(HEAD + text)
    return str(caught.value)


def random_axis(key, **law):
    return Axis(key, path_of(key), random=Distribution(**law))


def drawn(axis, seeds):
    return axis.at(np.zeros_like(seeds), seeds)


def scenarios(plan, rows):
    return list(scenarios_of(plan, plan.cases(np.asarray(rows, dtype=np.int64))))


def test_every_combination_of_seed_grid_and_policies_is_one_row(plan_from):
    plan = plan_from()
    cases = plan.cases(np.arange(plan.rows))
    assert plan.rows == 24
    assert (
        len(set(zip(cases.seed.tolist(), cases.values[0], cases.pair.tolist(), strict=True))) == 24
    )


def test_a_row_is_the_same_alone_as_among_others(plan_from):
    plan = plan_from()
    together = scenarios(plan, range(24))
    assert all(scenarios(plan, [row]) == [together[row]] for row in (0, 7, 23))


def test_a_row_is_the_same_after_the_plan_went_through_its_document(plan_from):
    plan = plan_from()
    assert scenarios(plan_of_manifest(plan.document), range(24)) == scenarios(plan, range(24))


def test_rows_that_differ_only_in_policy_or_grid_share_their_draws(plan_from):
    plan = plan_from()
    cases = plan.cases(np.arange(plan.rows))
    for seed in range(6):
        draws = {
            (*place, height)
            for place, height, one in zip(*cases.values[1:], cases.seed, strict=True)
            if one == seed
        }
        assert len(draws) == 1
    assert len(set(cases.values[2])) == 6


def test_another_swept_key_changes_no_draw(plan_from):
    plan = plan_from()
    more = plan_from(
        HEAD + 'seeds = 6\n[random]\n"sensor.latency_s" = { uniform = [0, 1] }\n'
        '"evader.position_m" = { annulus = [8, 14] }\n'
    )
    assert more.cases(np.arange(6)).values[1] == plan.cases(np.arange(6)).values[1]


def test_a_row_has_the_seed_the_policies_and_the_values_its_columns_show(plan_from):
    plan = plan_from()
    table = table_of_rows(plan, range(24)).to_pylist()
    for row, scenario in zip(table, scenarios(plan, range(24)), strict=True):
        assert row["evader.speed_m_s"] == scenario.evader.speed_m_s
        assert (
            row["evader.position_m[0]"],
            row["evader.position_m[1]"],
        ) == scenario.evader.position_m
        assert row["pursuer.position_m[2]"] == scenario.pursuer.position_m[2]
        assert (row["pursuer_policy"], row["evader_policy"]) == (scenario.pursuer.policy, "optimal")
        assert row["seed"] == scenario.seed


def test_every_row_was_checked_as_a_file_is(plan_from):
    for scenario in scenarios(plan_from(), range(24)):
        assert Scenario.model_validate(scenario.model_dump(mode="json")) == scenario


def test_a_row_without_a_game_is_kept_with_its_reason_and_its_place(plan_from):
    plan = plan_from(HEAD + '[grid]\n"evader.speed_m_s" = [2.0, 6.0, 3.0]\n')
    rows = table_of_rows(plan, range(3)).to_pylist()
    assert [row["end"] for row in rows] == ["captured", "invalid", "captured"]
    assert "must be above 1" in rows[1]["reason"]
    assert (rows[1]["pursuer_policy"], rows[1]["game"]) == ("optimal", "pe")


def test_a_course_stays_with_the_policy_that_follows_it(short, plan_from):
    (short / "short.toml").write_text(
        (short / "short.toml").read_text() + 'policy = "waypoints"\nwaypoints_m = [[0.0, 20.0]]\n'
    )
    plan = plan_from(HEAD + 'policies = [{ evader = ["waypoints", "optimal"] }]\n')
    assert [bool(scenario.evader.waypoints_m) for scenario in scenarios(plan, range(2))] == [
        True,
        False,
    ]


@pytest.mark.parametrize(
    ("law", "distribution"),
    [
        ({"uniform": [2, 5]}, stats.uniform(2, 3)),
        ({"log_uniform": [0.1, 10]}, stats.loguniform(0.1, 10)),
        ({"normal": [3, 0.5]}, stats.norm(3, 0.5)),
    ],
)
def test_draws_follow_the_distribution_they_are_named_after(law, distribution):
    values = np.array(drawn(random_axis("evader.speed_m_s", **law), np.arange(20000)))
    assert stats.kstest(values, distribution.cdf).pvalue > 0.001
    assert np.min(values) >= distribution.support()[0]
    assert np.max(values) <= distribution.support()[1]


def test_a_disc_is_even_by_area_and_about_its_centre():
    axis = random_axis("evader.position_m", annulus=[10, 20], about_m=[5, -7])
    places = np.array(drawn(axis, np.arange(20000))) - [5, -7]
    radius = np.hypot(*places.T)
    angle = np.arctan2(*places.T)
    assert stats.kstest((radius**2 - 100) / 300, "uniform").pvalue > 0.001
    assert stats.kstest(angle / (2 * np.pi) + 0.5, "uniform").pvalue > 0.001


def test_a_choice_is_even_among_its_values():
    axis = random_axis("pursuer.speed_set", choice=["ball", "cylinder"])
    values = drawn(axis, np.arange(10000))
    assert abs(values.count("ball") - 5000) < 250
    assert axis.columns() == {"pursuer.speed_set": pa.string()}


@given(st.floats(-1e6, 1e6), st.floats(1e-3, 1e6), st.integers(0, 2**62))
def test_what_is_drawn_lies_within_the_bounds(low, width, seed):
    (value,) = drawn(random_axis("a", uniform=[low, low + width]), np.array([seed]))
    assert low <= value <= low + width


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            '[grid]\n"pursuer.sped_m_s" = [3.0]\n',
            "pursuer.sped_m_s: unknown key; did you mean 'speed_m_s'?",
        ),
        ('[grid]\n"pursuer.speed_km_h" = [3.0]\n', "pursuer.speed_km_h: unknown key"),
        (
            '[grid]\n"pursuer.speed_m_s" = [3.0, 31.0]\n',
            "pursuer.speed_m_s = 31.0: must be less than",
        ),
        (
            '[random]\n"evader.speed_m_s" = { uniform = [-1.0, 2.0] }\n',
            "evader.speed_m_s = -1.0: must be gr",
        ),
        (
            '[random]\n"evader.speed_m_s" = { uniform = [2.0, 1.0] }\n',
            "{ uniform = [low, high] } with low < high",
        ),
        (
            '[random]\n"evader.speed_m_s" = { gamma = [2.0, 1.0] }\n',
            "gamma: unknown key; allowed here",
        ),
        (
            '[random]\n"evader.speed_m_s" = { normal = [2, 1], uniform = [1, 2] }\n',
            "must be one of { uniform",
        ),
        ('[random]\n"evader.speed_m_s" = { disc = 10 }\n', "evader.position_m as a whole"),
        ('[random]\n"evader.speed_m_s" = { log_uniform = [0.0, 2.0] }\n', "0 < low < high"),
        ('[grid]\n"evader.position_m[2]" = [3.0]\n', "the scenario has no element 2 there"),
        (
            '[grid]\n"evader.speed_m_s" = { from = 1.0, to = 2.0 }\n',
            "must be { from = …, to = …, count = … }",
        ),
        ('[grid]\n"evader.speed_m_s" = 2.0\n', "must be a list of values"),
        ('[grid]\n"evader.speed_m_s" = [2.0, 2.0]\n', "a value is given twice"),
        ("[grid]\nseed = [1, 2]\n", "seed: cannot be swept; use seeds"),
        ('[grid]\n"pursuer.policy" = ["optimal"]\n', "use policies"),
        ('[grid]\n"Pursuer Speed" = [1.0]\n', "must be a scenario's key"),
        ('policies = [{ pursuer = "magic" }]\n', "pursuer.policy = 'magic': allowed are optimal"),
        ('policies = [{ pursuer = "task_oriented" }]\n', "needs target.position_m"),
        (
            'policies = [{ pursuer = "optimal" }, { pursuer = "optimal" }]\n',
            "optimal against optimal is given twice",
        ),
        ("seeds = 3\nrows = 3\n", "give only one"),
        ("seeds = [1, 1]\n", "seeds: 1 is given twice"),
        ("seeds = [-1]\n", "greater than or equal to 0"),
        ('rows = 7\n[grid]\n"evader.speed_m_s" = [1.0, 2.0]\n', "must be a multiple of 2"),
        (
            '[grid]\n"evader.speed_m_s" = { from = 1.0, to = 2.0, count = 300000000 }\n',
            "evenly spaced values, 2 to 100000",
        ),
        ('[grid]\n"evader.position_m" = [[1, 2], [3, 4], [1.0, 2.0]]\n', "a value is given twice"),
        ("seeds = 1_000_000_000_000\n", "1000000000000 games; at most 1000000000 are allowed"),
        ("rows = 1_000_000_000_000\n", "1000000000000 games; at most 1000000000 are allowed"),
        (
            f"policies = [{{ pursuer = {['optimal'] * 3000}, evader = {['optimal'] * 3000} }}]\n",
            "policies: 9000000 pairs; at most 10000 are allowed",
        ),
        ("seeds = { from = 9223372036854775807, count = 2 }\n", "less than or equal to"),
        ("sedes = 3\n", "sedes: unknown key; did you mean 'seeds'?"),
        ('as = "live"\n', "as = 'live': must be 'maths' or 'fast'"),
        (
            '[grid]\n"evader.position_m[0]" = [1.0, 2.0]\n[random]\n"evader.position_m" = { disc = 5 }\n',
            "evader.position_m[0] is given twice",
        ),
    ],
)
def test_a_wrong_sweep_is_refused_with_key_value_and_allowed_values(plan_from, text, words):
    assert words in refused(plan_from, text)


def test_keys_written_as_tables_are_the_same_keys(plan_from):
    dotted = plan_from(HEAD + "[grid]\nevader.speed_m_s = { from = 1.0, to = 2.0, count = 3 }\n")
    assert dotted.cases(np.arange(3)).values == ([1.0, 1.5, 2.0],)


def test_seeds_are_a_number_a_list_or_a_range(plan_from):
    def seeds(text):
        plan = plan_from(HEAD + text)
        cases = plan.cases(np.arange(plan.rows))
        return cases.seed.tolist()

    assert seeds("seeds = 3\n") == [0, 1, 2]
    assert seeds("seeds = [9, 4]\n") == [9, 4]
    assert seeds("seeds = { from = 7, count = 2 }\n") == [7, 8]
    assert seeds("rows = 2\n") == [0, 1]


@pytest.mark.parametrize("name", ["policies", "barrier", "flown", "circles"])
def test_every_sweep_that_comes_along_can_be_run_and_says_what_it_is_about(name):
    plan = planned(name)
    assert plan.title
    assert plan.description
    found = scenarios(plan, np.unique(np.linspace(0, plan.rows - 1, 300).astype(int)))
    assert sum(isinstance(one, Scenario) for one in found) > 0.9 * len(found)
