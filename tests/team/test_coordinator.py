"""The election and the assignments on lossy, delayed and split networks."""

import math
from dataclasses import replace
from itertools import pairwise

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from guidance.frames import Enu
from guidance.game import Extent
from guidance.team.board import Board
from guidance.team.coordinator import Coordinator, CoordinatorView, EvaderSeen
from tests.team.virtual_team import GAME, VirtualTeam, state_of

TARGET = (0.0, 0.0, 0.0)
TEAM = {"alpha": (8.0, 0.0, 10.0), "bravo": (-4.0, 7.0, 10.0), "charlie": (-4.0, -7.0, 10.0)}
EVADERS = {"blue": (60.0, 0.0, 0.0), "red": (-30.0, 52.0, 0.0)}

FEW = settings(max_examples=4, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def virtual(places=TEAM, evaders=EVADERS, target=TARGET, **network):
    return VirtualTeam(places, evaders, target, **network)


def newest(point):
    """The assignment that a vehicle follows."""
    return point.board.roles.vehicle, point.board.roles.term


def broken(made):
    """Promises that became worse without a cause."""
    found = []
    for before, after in pairwise(made):
        values = {promise.evader: promise for promise in after.promises}
        for old in before.promises:
            new = values.get(old.evader)
            worse = (
                new is None
                or new.value is None
                or (old.value is not None and new.value < old.value)
            )
            if old.value is not None and worse and not (new and new.cause):
                found.append((old, new))
    return found


def test_the_lowest_name_coordinates_after_a_second():
    team = virtual(delay_s=0.02)
    team.run(0.9)
    assert all(point.board.roles is None for point in team.points.values())
    team.run(0.4)
    assert {newest(point) for point in team.points.values()} == {("alpha", 1)}


def test_an_event_is_matched_at_once():
    team = virtual()
    team.run(2.0, moving=False)
    team.points["charlie"].board.close(("red",), team.clock.now_s())
    team.run(0.15, moving=False)
    assert {role.evader for role in team.points["alpha"].made[-1].roles} == {"blue"}


def test_vehicles_at_one_evader_are_stacked():
    team = virtual(evaders={"red": EVADERS["red"]})
    team.run(2.0, moving=False)
    heights = sorted(role.above_m for role in team.points["alpha"].made[-1].roles)
    assert heights == [0.0, 4.0, 8.0]


@FEW
@given(st.integers(0, 999), st.floats(0.0, 0.3), st.floats(0.0, 0.15), st.sampled_from([*TEAM]))
def test_after_a_kill_the_next_name_takes_over_with_the_same_promises(seed, loss, delay_s, killed):
    """Catches promises that are lost with the leader."""
    team = virtual(delay_s=delay_s, jitter_s=delay_s, loss=loss, seed=seed)
    team.run(3.0)
    team.points[killed].killed = True
    team.run(3.0)
    leader = min(point.name for point in team.alive)
    assert {newest(point)[0] for point in team.alive} == {leader}
    assert all(role.vehicle != killed for point in team.alive for role in point.board.roles.roles)
    assert not broken(team.made)
    promised = {promise.evader for promise in team.points[leader].board.roles.promises}
    assert promised == set(EVADERS)


def test_a_silent_coordinator_is_replaced_within_a_second_and_a_half():
    team = virtual(delay_s=0.03)
    team.run(3.0)
    team.points["alpha"].killed = True
    team.run(1.5)
    assert {newest(point) for point in team.alive} == {("bravo", 2)}
    kept = {promise.evader: promise.value for promise in team.points["alpha"].made[-1].promises}
    for promise in team.points["bravo"].made[0].promises:
        assert promise.cause == "vehicle lost" or promise.value == kept[promise.evader]


@FEW
@given(st.integers(0, 999), st.floats(1.5, 10.0), st.sampled_from([*TEAM]))
def test_after_a_split_heals_all_follow_the_newest_term(seed, seconds, alone):
    """Catches two leaders that stay after a split has healed."""
    team = virtual(delay_s=0.03, jitter_s=0.05, loss=0.1, seed=seed)
    team.run(3.0)
    team.network.cut = {alone}
    team.run(seconds)
    team.network.cut = set()
    terms = max(point.board.term for point in team.points.values())
    team.run(2.5)
    assert len({newest(point) for point in team.points.values()}) == 1
    assert newest(team.points["alpha"])[1] >= terms
    for point in team.points.values():  # what one part promised, the other cannot know
        assert not broken(point.made)


def test_a_coordinator_that_restarts_does_not_block_the_team():
    team = virtual(delay_s=0.02)
    team.run(3.0)
    again = VirtualTeam(TEAM, EVADERS, TARGET).points["alpha"]
    old = team.points["alpha"]
    again.board = type(old.board)("alpha", [*TEAM], [*EVADERS])
    again.coordinator = type(old.coordinator)(again.board, 77, 4.0)
    again.transport = team.network.join("alpha")
    again.epoch = 77
    again.place_m = old.place_m
    team.points["alpha"] = again
    team.run(3.0)
    assert {newest(point) for point in team.points.values()} == {("alpha", 2)}


places = st.tuples(st.floats(-40.0, 40.0), st.floats(-40.0, 40.0), st.floats(8.0, 25.0))
grounds = st.tuples(st.floats(-90.0, 90.0), st.floats(-90.0, 90.0), st.just(0.0)).filter(
    lambda place: math.hypot(*place) > 20.0
)


@FEW
@given(
    st.lists(places, min_size=2, max_size=3),
    st.lists(grounds, min_size=1, max_size=3),
    st.sampled_from([TARGET, None]),
    st.integers(0, 999),
    st.lists(st.sampled_from(["kill", "cut", "capture", "nothing"]), min_size=2, max_size=4),
)
def test_promises_are_monotone_and_vehicles_agree_whatever_happens(
    vehicles, evaders, target, seed, transitions
):
    """Catches an order of losses, splits and captures after which a promise is withdrawn or two vehicles disagree."""
    places = dict(zip(TEAM, vehicles, strict=False))
    team = virtual(
        places,
        dict(zip(("blue", "green", "red"), evaders, strict=False)),
        target,
        delay_s=0.05,
        loss=0.2,
        seed=seed,
    )
    team.run(2.5)
    for transition in transitions:
        one = team.alive[-1]
        if transition == "kill" and len(team.alive) > 1:
            one.killed = True
        elif transition == "cut":
            team.network.cut = set() if team.network.cut else {one.name}
        elif transition == "capture":
            one.board.close([*team.evaders][:1], team.clock.now_s())
        team.run(1.5)
    team.network.cut = set()
    team.run(4.0)
    assert len({newest(point) for point in team.alive}) == 1
    for point in team.points.values() if target is not None else ():
        assert not broken(point.made)
    for made in team.made:
        names = [role.vehicle for role in made.roles]
        assert len(names) == len(set(names))
        stacked = [(role.evader, role.above_m) for role in made.roles]
        assert len(stacked) == len(set(stacked))


def promised(coordinator, now_s, part, evader_m):
    """The promises of an assignment with one evader at a place; all vehicles are where they begin."""
    vehicles = {
        name: (at, state_of(name, (at[1], at[0], -at[2]), part=part)) for name, at in TEAM.items()
    }
    scene = CoordinatorView(
        vehicles, {"blue": EvaderSeen(Enu(evader_m), 3.0, 3.0, 0.1)}, Enu(TARGET), GAME
    )
    return coordinator.assign(now_s, scene).promises


def test_before_the_game_promises_are_offers_that_end_without_a_trace():
    coordinator = Coordinator(Board("alpha", [*TEAM], [*EVADERS]), 1, 4.0)
    coordinator.elect(0.0, ["alpha"])
    assert coordinator.elect(2.0, ["alpha"])
    (offer,) = promised(coordinator, 2.0, "ready", (60.0, 0.0, 0.0))
    assert offer.value > 1.0
    assert promised(coordinator, 3.0, "ready", (2.0, 0.0, 0.0)) == ()
    (given_,) = promised(coordinator, 4.0, "playing", (60.0, 0.0, 0.0))
    (kept,) = promised(coordinator, 5.0, "playing", (2.0, 0.0, 0.0))
    assert kept.value == given_.value == offer.value


def test_what_the_noise_of_the_positions_takes_back_is_not_promised():
    values = {}
    for number in range(40):
        coordinator = Coordinator(Board("alpha", [*TEAM], [*EVADERS]), 1, 4.0)
        coordinator.elect(0.0, ["alpha"])
        assert coordinator.elect(2.0, ["alpha"])
        at = 3.0 + 0.1 * number
        promises = promised(coordinator, 2.0, "playing", (at, 0.0, 0.0))
        values[at] = promises[0].value if promises else None
    known = [value for value in values.values() if value is not None]
    assert None in values.values()
    assert 0.5 <= min(known) < 1.0


def test_the_coordinator_matches_by_the_vehicles_own_game():
    """A shape of the target that one vehicle cannot defend is not promised."""
    square = Extent(((-40.0, -40.0), (40.0, -40.0), (40.0, 40.0), (-40.0, 40.0)))
    for shape, promised_ones in ((Extent(), 1), (square, 0)):
        board = Board("alpha", ["alpha"], ["blue"])
        state = state_of("alpha", (0.0, 0.0, -15.0))
        evaders = {"blue": EvaderSeen(Enu((47.0, 0.0, 0.0)), 2.5, 2.5, 0.1)}
        game = replace(GAME, target_extent=shape)
        scene = CoordinatorView({"alpha": ((0.0, 0.0, 15.0), state)}, evaders, Enu(TARGET), game)
        made = Coordinator(board, 1, 4.0).assign(0.0, scene)
        assert len(made.promises) == promised_ones


def test_the_vehicle_that_is_ready_first_takes_no_evader_from_the_others():
    """Both pairings promise the same, because the descent decides; only one has ways that do not cross."""
    evaders = {
        "blue": EvaderSeen(Enu((20.0, 60.0, 0.0)), 3.0, 3.0, 0.1),
        "red": EvaderSeen(Enu((-20.0, 60.0, 0.0)), 3.0, 3.0, 0.1),
    }
    board = Board("alpha", ["alpha", "bravo"], [*evaders])
    coordinator = Coordinator(board, 1, 4.0)
    fast = {"speed_m_s": 7.0, "part": "ready"}
    alpha = Enu((0.0, 0.0, 20.0)), state_of("alpha", (0.0, 0.0, -20.0), **fast)
    bravo = Enu((20.0, 0.0, 20.0)), state_of("bravo", (0.0, 20.0, -20.0), **fast)

    def roles(now_s, vehicles):
        made = coordinator.assign(now_s, CoordinatorView(vehicles, evaders, Enu(TARGET), GAME))
        return {role.vehicle: role.evader for role in made.roles}

    evaders_of_alpha = roles(2.0, {"alpha": alpha})["alpha"]
    assert evaders_of_alpha in evaders
    assert roles(3.0, {"alpha": alpha, "bravo": bravo}) == {"alpha": "red", "bravo": "blue"}
    playing = {
        name: (place, state.model_copy(update={"part": "playing"}))
        for name, (place, state) in {"alpha": alpha, "bravo": bravo}.items()
    }
    assert roles(4.0, playing) == {"alpha": "red", "bravo": "blue"}
