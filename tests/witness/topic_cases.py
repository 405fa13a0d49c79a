"""Cases of PX4's topics over Zenoh: each plays one situation and says in words what was seen."""

import itertools
import math
import time
from collections.abc import Callable

from sitl_mock.px4.events import event_id
from sitl_mock.px4.messages import message_type
from tests.witness.client import Client, result_name
from tests.witness.topics import NAN, Topics

TopicCase = Callable[[Client, Topics], str]
CASES: dict[str, TopicCase] = {}
HOLD = 4
RTL = 5
TAKEOFF = 17
LAND = 18
FIRST = 23
STATES = {HOLD: "Hold", RTL: "Return", TAKEOFF: "Takeoff", LAND: "Land"}
RATES = (1, 2, 8, 20, 50, 100, 125, 250)
OWN_MODE = 4 << 16 | 11 << 24
REASONS = (
    "check_system_arm_auth_failed",
    "check_gf_violation_custom_gf",
    "check_modes_mission",
    "check_modes_local_pos",
    "check_modes_home_position",
)
"""Names of PX4's events, as many as an answer can have."""
TOLD = {
    event_id(name): name
    for name in (
        *REASONS,
        "check_external_modes_unresponsive",
        "commander_failsafe_enter_generic",
        "commander_mode_fallback_internal",
    )
}
"""Events about a mode's reasons, and about what follows."""
WARNING = 4
"""Log level of an event."""
EXECUTOR = {"topic": "vehicle_command_mode_executor", "source_component": 1001}


def topic_case(title: str) -> Callable[[TopicCase], TopicCase]:
    """Register a case under its title."""

    def registered(function: TopicCase) -> TopicCase:
        CASES[title] = function
        return function

    return registered


def named(state: int) -> str:
    """Return a mode in words."""
    return STATES.get(state, f"mode {state}")


def results(answers: list[int]) -> str:
    """Return the results of a command in words."""
    return ", ".join(result_name(answer) for answer in answers) or "no answer"


def shown(reply) -> str:
    """Return the reply to a registration in words."""
    if reply is None:
        return "no reply"
    message = reply.message
    verdict = "registered" if message.success else "refused"
    ids = (message.arming_check_id, message.mode_id, message.mode_executor_id)
    return f"{verdict}: check {ids[0]}, mode {ids[1]}, executor {ids[2]}"


@topic_case("rates at rest, Hz")
def rates(_client: Client, topics: Topics) -> str:
    begun_s = time.monotonic()
    time.sleep(20.0)
    seen = []
    for topic in topics.topics():
        rate = len(topics.heard(topic, begun_s)) / 20.0
        near = [nominal for nominal in RATES if abs(rate / nominal - 1.0) < 0.13]
        if near:
            seen.append(f"{topic} {near[0]}")
        elif rate > 0.0:
            seen.append(f"{topic} {rate:.1f}")
    return ", ".join(seen)


@topic_case("bytes of a payload; attachment")
def sizes(_client: Client, topics: Topics) -> str:
    seen = []
    attachments = set()
    for topic in topics.topics():
        heard = topics.heard(topic)
        if topic not in {"vehicle_command_ack", "register_ext_component_reply"}:
            seen.append(
                f"{topic} {'/'.join(str(size) for size in {sample.size for sample in heard})}"
            )
        for before, after in itertools.pairwise(heard):
            step = int.from_bytes(after.attachment[:8], "little")
            step -= int.from_bytes(before.attachment[:8], "little")
            late = int.from_bytes(after.attachment[8:16], "little") - after.message.timestamp
            own = after.attachment[16:].hex()
            attachments.add(
                f"{len(after.attachment)} bytes, counts by {step}, {own}"
                if late < 100_000
                else "late"
            )
    return f"{', '.join(seen)}; {' and '.join(sorted(attachments))}"


@topic_case("registration of a mode and its arming check")
def registration(_client: Client, topics: Topics) -> str:
    begun_s = time.monotonic()
    reply = topics.ask("Witness")
    quick = reply is not None and reply.at_s - begun_s < 0.1
    if reply is not None and reply.message.success:
        topics.unregister("Witness", reply.message)
    if reply is None or reply.message.mode_id not in range(FIRST, FIRST + 8):
        return shown(reply)
    ids = (reply.message.arming_check_id, reply.message.mode_executor_id)
    return (
        f"check {ids[0]}, a mode of 23 to 30, executor {ids[1]}{', within 0.1 s' if quick else ''}"
    )


@topic_case(
    "a second check, the first of its number since the boot: arming in the first mode before, until it replies, after"
)
def second_check(_client: Client, topics: Topics) -> str:
    with topics.registered("Witness") as reply:
        topics.choose(reply.mode_id)
        time.sleep(0.5)
        before = topics.last("vehicle_status").pre_flight_checks_pass
        second = topics.ask("Witness 2")
        time.sleep(0.7)
        between = topics.last("vehicle_status").pre_flight_checks_pass
        topics.checks[second.message.arming_check_id] = {"can_arm_and_run": True}
        time.sleep(1.0)
        after = topics.last("vehicle_status").pre_flight_checks_pass
        topics.unregister("Witness 2", second.message)
        topics.choose(HOLD)
    return ", ".join("yes" if seen else "no" for seen in (before, between, after))


@topic_case("registration of a mode without a check, of an executor without a mode, of nothing")
def wrong_registration(_client: Client, topics: Topics) -> str:
    seen = [
        shown(topics.ask("Witness", register_arming_check=False)),
        shown(topics.ask("Witness", register_mode=False, register_mode_executor=True)),
        shown(topics.ask("Witness", register_mode=False, register_arming_check=False)),
    ]
    return "; ".join(seen)


@topic_case("nine modes")
def nine_modes(_client: Client, topics: Topics) -> str:
    replies = []
    for number in range(9):
        reply = topics.ask(f"Witness {number}")
        replies.append(reply)
        if reply is not None and reply.message.success:
            topics.checks[reply.message.arming_check_id] = {"can_arm_and_run": True}
    for number, reply in enumerate(replies):
        if reply is not None and reply.message.success:
            topics.unregister(f"Witness {number}", reply.message)
    modes = [reply.message.mode_id if reply is not None else None for reply in replies]
    eight = sorted(modes[:8]) == list(range(FIRST, FIRST + 8))
    return f"{'23 to 30, each once' if eight else modes[:8]}; {modes[8]}"


@topic_case("a mode that is registered again after another: its number")
def kept_number(_client: Client, topics: Topics) -> str:
    numbers = {}
    for order in (("Witness A", "Witness B"), ("Witness B", "Witness A")):
        replies = [topics.ask(name) for name in order]
        for name, reply in zip(order, replies, strict=True):
            if reply is not None and reply.message.success:
                numbers.setdefault(name, []).append(reply.message.mode_id)
                topics.unregister(name, reply.message)
    return "the same" if all(a == b for a, b in numbers.values()) else str(numbers)


@topic_case("requests for arming checks: per second, numbers, mask")
def requests(_client: Client, topics: Topics) -> str:
    with topics.registered("Witness"):
        begun_s = time.monotonic()
        time.sleep(10.0)
        asked = [heard.message for heard in topics.heard("arming_check_request", begun_s)]
    steps = {
        (after.request_id - before.request_id) % 256 for before, after in itertools.pairwise(asked)
    }
    masks = {request.valid_registrations_mask for request in asked}
    return f"{len(asked) / 10.0:.0f}, by {steps}, {masks}"


@topic_case("a check that says no: mode chosen on the ground, armed in it")
def refused_arming(_client: Client, topics: Topics) -> str:
    with topics.registered("Witness", answers={"can_arm_and_run": False}) as reply:
        chosen = results(topics.choose(reply.mode_id))
        topics.until_state(lambda state: state == reply.mode_id)
        time.sleep(0.3)
        passes = topics.last("vehicle_status").pre_flight_checks_pass
        armed = results(topics.command(400, 1.0))
        topics.choose(HOLD)
    return f"{chosen}, checks {'pass' if passes else 'fail'}; {armed}"


@topic_case("a check that says no, then yes: mode chosen in the air")
def refused_mode(_client: Client, topics: Topics) -> str:
    no = {"can_arm_and_run": False}
    with topics.flying("Witness", enters=False, answers=no) as reply:
        refused = results(topics.choose(reply.mode_id))
        stays = named(topics.state)
        topics.checks[reply.arming_check_id] = {"can_arm_and_run": True}
        time.sleep(0.7)
        granted = results(topics.choose(reply.mode_id))
        entered_s = topics.until_state(lambda state: state == reply.mode_id)
    return f"{refused}, {stays}; {granted}, flown within {0.1 if entered_s < 0.1 else entered_s} s"


@topic_case("a requirement that is not met: mode chosen in the air without sticks")
def requirement(_client: Client, topics: Topics) -> str:
    answers = {"can_arm_and_run": True, "mode_req_manual_control": True}
    with topics.flying("Witness", enters=False, answers=answers) as reply:
        return results(topics.choose(reply.mode_id))


def events(client: Client, mode_id: int, seconds: float) -> str:
    """Return in words the events about a mode that the station is told within some seconds."""
    told = {}
    for message in client.gather("UNKNOWN_410", seconds):  # EVENT, which pymavlink does not know
        payload = bytes(message.data)[10:].ljust(60, b"\0")
        number = int.from_bytes(payload[:4], "little")
        if number in TOLD and payload[12] & 0xF <= WARNING:
            modes = int.from_bytes(payload[13:17], "little")
            own = " own mode" if modes == 1 << mode_id else ""
            told[f"{TOLD[number]} {payload[12]:02x}{own}"] = None
    return ", ".join(sorted(told)) or "none"


@topic_case(
    "EVENT of a check that says no for five reasons, then yes, then is silent, on the ground"
)
def reasons_on_the_ground(client: Client, topics: Topics) -> str:
    flat = []
    for name in REASONS:
        flat += [0, event_id(name), 0, *[0] * 25, 0x33]
    refused = {"can_arm_and_run": False, "num_events": len(REASONS), "events": flat}
    seen = []
    with topics.registered("Witness") as reply:
        topics.choose(reply.mode_id)
        client.gather("HEARTBEAT", 3.0)
        for answers in (refused, {"can_arm_and_run": True}, None):
            if answers is None:
                topics.checks.clear()
            else:
                topics.checks[reply.arming_check_id] = answers
            seen.append(events(client, reply.mode_id, 5.0))
        topics.choose(HOLD)
    return "; ".join(seen)


@topic_case("EVENT when a program falls silent in flight")
def reasons_in_flight(client: Client, topics: Topics) -> str:
    with topics.flying("Witness") as reply:
        client.drain()
        topics.checks.clear()
        return events(client, reply.mode_id, 5.0)


@topic_case("velocity of 5 m/s in the mode for 8 s; before the first setpoint; after the last one")
def velocity(_client: Client, topics: Topics) -> str:
    with topics.flying("Witness"):
        time.sleep(2.0)
        still = topics.last("vehicle_local_position")
        topics.fly(8.0, 5.0)
        flown = topics.last("vehicle_local_position")
        time.sleep(2.0)
        after = topics.last("vehicle_local_position")
        topics.come_down()
    before = "stands" if math.hypot(still.vx, still.vy) < 1.0 else f"{still.vx:.1f} m/s"
    kept = "kept" if after.vx > 0.9 * flown.vx else f"{after.vx:.1f} m/s"
    reached = "4.5 m/s" if abs(flown.vx - 4.5) < 0.25 else f"{flown.vx:.1f} m/s"
    return f"{before}; {reached}; {kept}"


@topic_case("5 m/s sent for 6 s in Hold")
def setpoints_in_hold(_client: Client, topics: Topics) -> str:
    with topics.flying("Witness", enters=False):
        begun_s = time.monotonic()
        topics.fly(6.0, 5.0)
        heard = topics.heard("vehicle_local_position", begun_s)
        fastest_m_s = max(sample.message.vx for sample in heard)
    if fastest_m_s > 4.0:
        return "flown"
    return "disturb it" if fastest_m_s > 0.3 else "not flown"


@topic_case("a program that falls silent in flight: time, mode flown, and again when it replies")
def silent(_client: Client, topics: Topics) -> str:
    with topics.flying("Witness") as reply:
        check = topics.checks.pop(reply.arming_check_id)
        left_s = topics.until_state(lambda state: state != reply.mode_id)
        time.sleep(0.2)
        flown = named(topics.state)
        failsafe = topics.last("vehicle_status").failsafe
        topics.checks[reply.arming_check_id] = check
        back_s = topics.until_state(lambda state: state == reply.mode_id)
        topics.come_down()
    time_s = "0.9 to 1.5 s" if 0.9 < left_s < 1.5 else f"{left_s:.2f} s"
    again = "flown again" if back_s < 1.0 else "not flown again"
    return f"{time_s}, {flown}{', failsafe' if failsafe else ''}; {again}"


@topic_case("a silent program on the ground, its mode not chosen")
def forgotten(_client: Client, topics: Topics) -> str:
    with topics.registered("Witness") as reply:
        topics.checks.clear()
        gone = topics.wait(
            "vehicle_status",
            lambda status: not status.can_set_nav_states_mask >> reply.mode_id & 1,
            seconds=6.0,
        )
    return "forgotten" if gone is not None else "kept"


@topic_case("a mode that is unregistered while it is flown")
def unregistered(_client: Client, topics: Topics) -> str:
    with topics.flying("Witness") as reply:
        topics.unregister("Witness", reply)
        left_s = topics.until_state(lambda state: state != reply.mode_id)
        flown = named(topics.state)
    return f"{flown} within {0.3 if left_s < 0.3 else left_s} s"


@topic_case("armed in the mode on the ground, climb commanded for 5 s")
def no_take_off(_client: Client, topics: Topics) -> str:
    with topics.registered("Witness") as reply:
        topics.choose(reply.mode_id)
        topics.until_state(lambda state: state == reply.mode_id)
        time.sleep(0.3)
        armed = results(topics.command(400, 1.0))
        topics.fly(5.0, 0.0, -2.0)
        landed = topics.last("vehicle_land_detected").landed
        topics.command(400, 0.0, 21196.0)
        topics.choose(HOLD)
    return f"{armed}, {'stays on the ground' if landed else 'takes off'}"


@topic_case("a mode that replaces Return: flown, then silent")
def replaced(_client: Client, topics: Topics) -> str:
    wanted = {"enable_replace_internal_mode": True, "replace_internal_mode": RTL}
    with topics.flying("Witness", enters=False, **wanted) as reply:
        again = topics.ask("Witness 2", **wanted)
        answered = results(topics.command(20))
        topics.until_state(lambda state: state == reply.mode_id)
        status = topics.last("vehicle_status")
        flown = (
            status.nav_state == reply.mode_id,
            status.nav_state_user_intention == reply.mode_id,
        )
        topics.checks.clear()
        topics.until_state(lambda state: state != reply.mode_id)
        time.sleep(0.2)
        then = named(topics.state)
        failsafe = topics.last("vehicle_status").failsafe
    return (
        f"{answered}, flown and intended {flown}; {then}{', failsafe' if failsafe else ''}; "
        f"a second one: {shown(again)}"
    )


@topic_case("commands of an executor: not in charge, in charge")
def executor(_client: Client, topics: Topics) -> str:
    with topics.registered("Witness", register_mode_executor=True) as reply:
        early = results(topics.choose(HOLD, **EXECUTOR))
        topics.choose(reply.mode_id)
        topics.wait("vehicle_status", lambda status: status.executor_in_charge == 1)
        charge = topics.last("vehicle_status").executor_in_charge
        time.sleep(0.3)
        armed = results(topics.command(400, 1.0, **EXECUTOR))
        begun_s = time.monotonic()
        topics.command(22, NAN, NAN, NAN, NAN, NAN, NAN, NAN, **EXECUTOR)
        completed = topics.wait(
            "mode_completed", lambda mode: mode.nav_state == TAKEOFF, since_s=begun_s, seconds=40.0
        )
        time.sleep(1.0)
        after = named(topics.state)
        still = topics.last("vehicle_status").executor_in_charge
        chosen = results(topics.choose(reply.mode_id, **EXECUTOR))
        topics.until_state(lambda state: state == reply.mode_id)
        landing_s = time.monotonic()
        topics.command(21, **EXECUTOR)
        landed = topics.wait(
            "mode_completed", lambda mode: mode.nav_state == LAND, since_s=landing_s, seconds=60.0
        )
        topics.wait("vehicle_status", lambda status: status.arming_state == 1, seconds=20.0)
        time.sleep(0.2)
        last = "its own mode" if topics.state == reply.mode_id else named(topics.state)
        topics.choose(HOLD)
        time.sleep(0.2)
        ended = topics.last("vehicle_status").executor_in_charge
    return (
        f"{early}; in charge {charge}, armed: {armed}, take-off {'completed' if completed else 'not completed'}, "
        f"then {after}, in charge {still}, mode: {chosen}, landing {'completed' if landed else 'not completed'}, "
        f"disarmed {last}; after a user's choice in charge {ended}"
    )


@topic_case("mode after landing and disarming, without an executor")
def after_disarming(_client: Client, topics: Topics) -> str:
    with topics.flying("Witness") as reply:
        topics.command(21)
        topics.wait("vehicle_status", lambda status: status.arming_state == 1, seconds=60.0)
        time.sleep(0.3)
        seen = "the mode" if topics.state == reply.mode_id else named(topics.state)
        topics.choose(HOLD)
    return seen


@topic_case(
    "answers to commands: an unknown one, for another system, DO_SET_MODE, a mode that does not exist"
)
def commands(_client: Client, topics: Topics) -> str:
    seen = [
        results(topics.command(31999)),
        results(topics.command(400, 0.0, target_system=7)),
        results(topics.command(176, 1.0, 4.0, 3.0)),
        results(topics.choose(200)),
    ]
    topics.choose(HOLD)
    return "; ".join(seen)


@topic_case("answers to MAVLink's commands on the topic: DO_SET_MODE, arming, SET_MESSAGE_INTERVAL")
def answers_to_mavlink(client: Client, topics: Topics) -> str:
    seen = []
    for number, *params in ((176, 1, 4, 3), (400, 0), (511, 30, 0)):
        begun_s = time.monotonic()
        client.command(number, *params)
        time.sleep(0.3)
        answers = [
            heard.message.result
            for heard in topics.heard("vehicle_command_ack", begun_s)
            if heard.message.command == number
        ]
        seen.append(results(answers))
    return "; ".join(seen)


@topic_case(
    "topics that come back: mode_completed, config_control_setpoints; a payload that is too long"
)
def echoes(_client: Client, topics: Topics) -> str:
    begun_s = time.monotonic()
    topics.send("mode_completed", result=100, nav_state=FIRST)
    completed = topics.wait("mode_completed", lambda mode: mode.nav_state == FIRST, since_s=begun_s)
    begun_s = time.monotonic()
    topics.send("config_control_setpoints", flag_control_rates_enabled=True, source_id=99)
    config = topics.wait("vehicle_control_mode", lambda mode: mode.source_id == 99, since_s=begun_s)
    begun_s = time.monotonic()
    topics.send_bytes("mode_completed", b"\0\1\0\0" + bytes(9) + b"\x07" + bytes(7))
    long = topics.wait(
        "mode_completed", lambda mode: mode.nav_state == 7, since_s=begun_s, seconds=1.0
    )
    begun_s = time.monotonic()
    topics.send_bytes("mode_completed", b"\0\1\0\0" + bytes(9) + b"\x08" + bytes(6))
    fits = topics.wait(
        "mode_completed", lambda mode: mode.nav_state == 8, since_s=begun_s, seconds=1.0
    )
    return ", ".join("yes" if seen else "no" for seen in (completed, config, long, fits))


@topic_case("config_control_setpoints in flight that says disarmed")
def stopped(_client: Client, topics: Topics) -> str:
    with topics.flying("Witness"):
        topics.fly(4.0, 0.0, -2.0)
        begun_s = time.monotonic()
        for _ in range(6):  # one may come just before PX4 publishes its own
            topics.send("config_control_setpoints", flag_control_velocity_enabled=True)
            topics.fly(0.1)
        topics.fly(1.0)
        fallen_m_s = max(
            heard.message.vz for heard in topics.heard("vehicle_local_position", begun_s)
        )
    return "the motors stop for a moment" if fallen_m_s > 1.0 else "no effect"


@topic_case("goto_setpoint 10 m away for 3 s: whole, cut to 44 bytes")
def goto(_client: Client, topics: Topics) -> str:
    kind = message_type("GotoSetpoint")
    moved = []
    with topics.flying("Witness"):
        for size in (4 + kind.size, 44):
            begun = topics.last("vehicle_local_position")
            payload = kind.encoded(position=(begun.x + 10.0, begun.y, begun.z))[:size]
            for _ in range(150):
                topics.send_bytes("goto_setpoint", payload)
                time.sleep(0.02)
            moved.append(topics.last("vehicle_local_position").x - begun.x)
    return ", ".join("flown" if metres > 1.5 else "not flown" for metres in moved)


@topic_case("config_overrides_request: is a vehicle that does not take off disarmed?")
def overrides(_client: Client, topics: Topics) -> str:
    with topics.registered("Witness", register_mode_executor=True) as reply:
        topics.choose(reply.mode_id)
        time.sleep(0.3)
        owners = ((0, reply.mode_id), (1, reply.mode_executor_id))
        for kind, number in owners:
            topics.send(
                "config_overrides_request",
                disable_auto_disarm=True,
                source_type=kind,
                source_id=number,
            )
        begun_s = time.monotonic()
        if topics.command(400, 1.0) != [0]:
            return "not armed"
        topics.wait("vehicle_status", lambda status: status.arming_state == 1, seconds=20.0)
        after_s = time.monotonic() - begun_s
        topics.choose(HOLD)
    return "yes, within 15 s" if after_s < 15.0 else "no"


@topic_case("mode_completed of landing, of Return: per second from landing to disarming")
def completions(_client: Client, topics: Topics) -> str:
    seen = []
    for command, state in ((21, LAND), (20, RTL)):
        topics.take_off()
        begun_s = time.monotonic()
        topics.command(command)
        topics.wait("vehicle_status", lambda status: status.arming_state == 1, seconds=90.0)
        told = [
            heard.at_s
            for heard in topics.heard("mode_completed", begun_s)
            if heard.message.nav_state == state
        ]
        if len(told) > 1:
            rate = (len(told) - 1) / (told[-1] - told[0])
            seen.append("20" if abs(rate - 20.0) < 3.0 else f"{rate:.0f}")
        else:
            seen.append(f"{len(told)} in all")
        topics.choose(HOLD)
    return ", ".join(seen)


@topic_case("the mode over MAVLink: AVAILABLE_MODES, its monitor, chosen by DO_SET_MODE, HEARTBEAT")
def over_mavlink(client: Client, topics: Topics) -> str:
    client.drain()
    with topics.registered("Witness") as reply:
        client.send.command_long_send(client.system, 1, 512, 0, 435, 0, 0, 0, 0, 0, 0)
        modes = {}
        while (mode := client.wait("AVAILABLE_MODES", seconds=1.0)) is not None:
            modes[mode.custom_mode] = mode
        own = modes.get(4 << 16 | (reply.mode_id - 12) << 24)
        other = modes.get(4 << 16 | (reply.mode_id - 11) << 24)
        monitor = client.wait("AVAILABLE_MODES_MONITOR", seconds=8.0)
        chosen = client.command(176, 1, 4, reply.mode_id - 12)
        topics.until_state(lambda state: state == reply.mode_id)
        client.gather("HEARTBEAT", 1.2)
        beat = client.wait("HEARTBEAT")
        topics.choose(HOLD)
    if own is None or other is None or beat is None:
        return "not listed"
    listed = f"{own.mode_name!r} {own.properties}, {other.mode_name!r} {other.properties}"
    again = "monitor sent" if monitor is not None else "no monitor"
    return f"{listed}; {again}; {chosen}, base_mode {beat.base_mode}, {beat.custom_mode == own.custom_mode}"
