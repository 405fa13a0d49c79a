"""Parameters: typed as each flavour does it, by name, by index, as a list, with echo and errors."""

import math
import struct
import zlib

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from sitl_mock import MockVehicle
from sitl_mock.parameters import parameters_of
from sitl_mock.protocols import (
    ARDUPILOT_PARAMETER_RULES,
    PX4_PARAMETER_RULES,
    Parameter,
    ParameterError,
    ParameterProtocol,
    ParameterStore,
    ParamKind,
)
from sitl_mock.protocols.parameter import rounded

INT32 = int(ParamKind.INT32)
REAL32 = int(ParamKind.REAL32)
TABLES = ["px4", "arducopter", "rover"]


def as_float(integer):
    return struct.unpack("<f", struct.pack("<i", integer))[0]


def as_integer(wire_value):
    return struct.unpack("<i", struct.pack("<f", wire_value))[0]


@pytest.fixture
def px4():
    return ParameterStore(parameters_of("px4"))


@pytest.fixture
def copter():
    return ParameterStore(parameters_of("arducopter"))


def read(client, name, index=-1):
    return client.send("PARAM_REQUEST_READ", 1, 1, name.encode(), index)


def write(client, name, value, kind):
    return client.send("PARAM_SET", 1, 1, name.encode(), value, kind)


@pytest.mark.parametrize("flavour", TABLES)
def test_the_tables_name_each_parameter_once_within_its_limits_and_its_type(flavour):
    table = parameters_of(flavour)
    names = [item.name for item in table]
    assert len(names) == len(set(names))
    assert len([item for item in table if item.meaning]) >= 60
    for item in table:
        assert 0 < len(item.name) <= 16
        assert item.minimum <= item.default <= item.maximum, item
        assert rounded(item.kind, item.default) == pytest.approx(item.default, rel=1e-6), item


@pytest.mark.parametrize(
    ("flavour", "kinds"),
    [("px4", {6: 285, 9: 602}), ("arducopter", {2: 419, 4: 327, 6: 87, 9: 557})],
)
def test_row_15_all_parameters_of_the_real_ones_are_there_with_their_types(flavour, kinds):
    table = [item for item in parameters_of(flavour) if not item.behind]
    assert {kind: sum(item.kind == kind for item in table) for kind in kinds} == kinds
    assert len(table) == {"px4": 887, "arducopter": 1390}[flavour]


@pytest.mark.parametrize(
    ("flavour", "recorded"),
    [
        (
            "px4",
            {
                "RTL_RETURN_ALT": 30.0,
                "RTL_DESCEND_ALT": 10.0,
                "NAV_ACC_RAD": 2.0,
                "COM_LOW_BAT_ACT": 3,
                "COM_RC_IN_MODE": 1,
                "MC_ROLL_P": 4.0,
            },
        ),
        ("arducopter", {"FENCE_RADIUS": 150.0}),
    ],
)
def test_row_25_defaults_are_those_that_were_read_from_the_real_ones(flavour, recorded):
    store = ParameterStore(parameters_of(flavour))
    assert {name: store[name] for name in recorded} == recorded


@pytest.mark.parametrize(
    ("flavour", "name"), [("px4", "MAV_SYS_ID"), ("arducopter", "SYSID_THISMAV")]
)
def test_a_vehicle_knows_its_own_number(flavour, name):
    assert MockVehicle(flavour, system_id=7).autopilot.parameters[name] == 7


def test_the_defaults_that_decide_over_offboard_are_those_of_the_autopilots(px4, copter):
    assert {
        name: px4[name]
        for name in ("COM_OF_LOSS_T", "COM_OBL_RC_ACT", "COM_FAIL_ACT_T", "MPC_XY_VEL_MAX")
    } == {
        "COM_OF_LOSS_T": 1.0,
        "COM_OBL_RC_ACT": 0,
        "COM_FAIL_ACT_T": 5.0,
        "MPC_XY_VEL_MAX": 12.0,
    }
    assert (copter["GUID_TIMEOUT"], copter["WPNAV_SPEED"], copter["WPNAV_SPEED_UP"]) == (
        3.0,
        1000.0,
        250.0,
    )


def test_px4_reads_an_integer_as_its_four_bytes_and_a_float_as_itself(wire, px4):
    client = wire(ParameterProtocol(px4, PX4_PARAMETER_RULES))
    (integer,) = read(client, "NAV_RCL_ACT")
    assert (integer.param_id, as_integer(integer.param_value), integer.param_type) == (
        "NAV_RCL_ACT",
        2,
        INT32,
    )
    (real,) = read(client, "MPC_XY_P")
    assert (real.param_value, real.param_type) == (pytest.approx(0.95), REAL32)
    assert real.param_count == len(px4.names)
    assert real.param_index == px4.index["MPC_XY_P"]


def test_ardupilot_casts_the_number_and_says_the_small_type(wire, copter):
    client = wire(ParameterProtocol(copter, ARDUPILOT_PARAMETER_RULES))
    (value,) = read(client, "FS_THR_VALUE")
    assert (value.param_value, value.param_type) == (975.0, int(ParamKind.INT16))
    (value,) = read(client, "FENCE_ENABLE")
    assert (value.param_value, value.param_type) == (0.0, int(ParamKind.INT8))
    assert value.param_index == 0xFFFF  # only list entries carry the index


def test_by_index_gives_what_the_list_gives(wire, px4):
    client = wire(ParameterProtocol(px4, PX4_PARAMETER_RULES))
    for index in (0, 7, len(px4.names) - 1):
        (by_index,) = read(client, "", index)
        (by_name,) = read(client, by_index.param_id)
        assert (by_index.param_index, by_name.param_index) == (index, index)
        assert by_index.to_dict() == by_name.to_dict()


@pytest.mark.parametrize("rules", [PX4_PARAMETER_RULES, ARDUPILOT_PARAMETER_RULES])
def test_a_list_holds_every_parameter_once_at_its_pace(wire, copter, rules):
    client = wire(ParameterProtocol(copter, rules))
    start = client.send("PARAM_REQUEST_LIST", 1, 1)
    came = client.wait(0.1)
    assert len(came) == pytest.approx(0.1 * rules.list_hz, abs=2)
    came += client.wait(3.0)
    assert [value.param_index for value in came] == list(range(len(copter.names)))
    assert [value.param_id for value in came] == list(copter.names)
    assert [value.param_id for value in start] == (["_HASH_CHECK"] if rules.hash_check else [])
    assert client.wait(1.0) == []


def test_a_repeated_list_request_starts_again(wire, px4):
    client = wire(ParameterProtocol(px4, PX4_PARAMETER_RULES))
    client.send("PARAM_REQUEST_LIST", 1, 1)
    client.wait(0.1)
    client.send("PARAM_REQUEST_LIST", 1, 1)
    assert [value.param_index for value in client.wait(2.0)] == list(range(len(px4.names)))


def test_the_hash_is_that_of_names_and_values_and_changes_with_them(wire, px4):
    client = wire(ParameterProtocol(px4, PX4_PARAMETER_RULES))
    (first,) = read(client, "_HASH_CHECK")
    assert (first.param_type, first.param_index, first.param_count) == (5, 0xFFFF, len(px4.names))
    table = []
    for byte in range(256):  # the CRC-32 of NuttX: reflected, no inversion before or after
        crc = byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xEDB88320 if crc & 1 else 0)
        table.append(crc)
    crc = 0
    volatile = {
        "COM_FLIGHT_UUID",
        "EKF2_MAG_DECL",
        "LND_FLIGHT_T_HI",
        "LND_FLIGHT_T_LO",
        "SENS_DPRES_OFF",
    }
    for name in sorted(px4.names):
        offset = name.startswith("CAL_") and name.endswith(("OFF", "SCALE", "COMP", "ODIAG"))
        if name in volatile or offset or name.startswith("ASPD_SCALE_"):
            continue
        kind = "<f" if px4.definitions[name].kind is ParamKind.REAL32 else "<i"
        for byte in name.encode() + struct.pack(kind, px4[name]):
            crc = table[(crc ^ byte) & 0xFF] ^ crc >> 8
    assert px4.hash() == crc
    px4.set("CAL_MAG0_XOFF", 0.1)
    assert px4.hash() == crc
    px4.set("NAV_RCL_ACT", -1)
    assert px4.hash() != crc


def test_row_15_the_hash_of_px4s_defaults_is_the_one_that_the_real_one_sent(px4):
    assert px4.hash() == 0x2FABB5D5


def test_row_15_lists_are_in_the_order_of_the_real_ones():
    copter = ParameterStore(parameters_of("arducopter"))
    px4 = ParameterStore(parameters_of("px4"))
    assert [copter.names[index] for index in (0, 1, 5, 500, 1389)] == [
        "FORMAT_VERSION",
        "SYSID_THISMAV",
        "PILOT_THR_BHV",
        "SIM_SERVO_SPEED",
        "FILT8_TYPE",
    ]
    # All names as ArduCopter 4.5.7 sent them
    assert zlib.crc32("\n".join(copter.names).encode()) == 0xE2462D8B
    assert list(px4.names) == sorted(px4.names)
    assert (px4.index["LND_FLIGHT_T_HI"], px4.index["MPC_XY_VEL_MAX"]) == (500, 622)


def test_a_ground_station_that_knows_the_hash_stops_the_list(wire, px4):
    protocol = ParameterProtocol(px4, PX4_PARAMETER_RULES)
    client = wire(protocol)
    client.send("PARAM_REQUEST_LIST", 1, 1)
    assert write(client, "_HASH_CHECK", 0.0, 5) == []
    assert client.wait(1.0) == []


def test_setting_answers_with_the_value_as_stored(wire, px4):
    client = wire(ParameterProtocol(px4, PX4_PARAMETER_RULES))
    (echo,) = write(client, "COM_OF_LOSS_T", 1.1, REAL32)
    assert (
        echo.param_value == struct.unpack("<f", struct.pack("<f", 1.1))[0] == px4["COM_OF_LOSS_T"]
    )
    (echo,) = write(client, "COM_OBL_RC_ACT", as_float(5), INT32)
    assert (as_integer(echo.param_value), px4["COM_OBL_RC_ACT"]) == (5, 5)
    (echo,) = write(client, "EKF2_NOAID_TOUT", as_float(-3), INT32)
    assert px4["EKF2_NOAID_TOUT"] == -3


def is_signalling_nan(integer):
    return (
        integer & 0x7F800000 == 0x7F800000 and integer & 0x7FFFFF != 0 and integer & 0x400000 == 0
    )


@given(st.one_of(st.sampled_from([-1, -2, 2**31 - 1]), st.integers(-(2**31), 2**31 - 1)))
def test_every_integer_that_is_no_signalling_nan_survives_px4s_encoding(value):
    assume(not is_signalling_nan(value))
    store = ParameterStore([Parameter("X", ParamKind.INT32, 0, "", -(2**31), 2**31 - 1, "test")])
    store.set("X", value)
    (reply,) = ParameterProtocol(store, PX4_PARAMETER_RULES).handle(0.0, _Read("X"))
    assert as_integer(reply[2]) == value


class _Read:
    param_index = -1

    def __init__(self, name):
        self.param_id = name

    def get_type(self):
        return "PARAM_REQUEST_READ"


def test_ardupilot_rounds_and_clamps_to_its_type(wire, copter):
    client = wire(ParameterProtocol(copter, ARDUPILOT_PARAMETER_RULES))
    for sent, stored in ((1.4, 1), (1.5, 2), (-1.5, -2), (900.0, 127), (-900.0, -128)):
        (echo,) = write(client, "FS_THR_ENABLE", sent, REAL32)
        assert (echo.param_value, copter["FS_THR_ENABLE"]) == (stored, stored)


def test_ardupilot_calls_a_default_that_was_never_saved_a_float_except_outside_groups(wire, copter):
    client = wire(ParameterProtocol(copter, ARDUPILOT_PARAMETER_RULES))
    said = []
    for name, value in (("FENCE_ENABLE", 0), ("FENCE_ENABLE", 1), ("FENCE_ENABLE", 0)):
        (echo,) = write(client, name, value, int(ParamKind.INT8))
        said.append((echo.param_value, echo.param_type))
    assert said == [(0, REAL32), (1, ParamKind.INT8), (0, ParamKind.INT8)]
    (echo,) = write(client, "RTL_ALT", 1500, REAL32)
    assert (echo.param_value, echo.param_type) == (1500, INT32)


@pytest.mark.parametrize("rules", [PX4_PARAMETER_RULES, ARDUPILOT_PARAMETER_RULES])
def test_row_15_an_unknown_name_or_index_is_met_with_silence_and_changes_nothing(wire, px4, rules):
    client = wire(ParameterProtocol(px4, rules))
    before = dict(px4)
    assert read(client, "NO_SUCH") == read(client, "", len(px4.names)) == []
    assert write(client, "NO_SUCH", 1.0, REAL32) == []
    assert (dict(px4), px4.revision) == (before, 0)


def test_row_15_px4_is_silent_about_another_type_and_keeps_the_value(wire, px4):
    client = wire(ParameterProtocol(px4, PX4_PARAMETER_RULES))
    assert write(client, "COM_OBL_RC_ACT", 5.0, REAL32) == []
    assert px4["COM_OBL_RC_ACT"] == 0


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_is_not_stored(wire, copter, bad):
    client = wire(ParameterProtocol(copter, ARDUPILOT_PARAMETER_RULES))
    assert write(client, "GUID_TIMEOUT", bad, REAL32) == []
    assert copter["GUID_TIMEOUT"] == 3.0


@pytest.mark.parametrize(
    ("rules", "name", "value"),
    [
        (PX4_PARAMETER_RULES, "COM_OF_LOSS_T", 900.0),
        (ARDUPILOT_PARAMETER_RULES, "GUID_TIMEOUT", 900.0),
    ],
)
def test_row_15_neither_autopilot_enforces_the_documented_range(wire, rules, name, value):
    store = ParameterStore(parameters_of("px4" if rules.bytewise else "arducopter"))
    client = wire(ParameterProtocol(store, rules))
    assert write(client, name, value, REAL32)[0].param_value == value == store[name]


def test_row_15_ardupilot_denies_what_only_itself_may_set_and_says_so(wire, copter):
    client = wire(ParameterProtocol(copter, ARDUPILOT_PARAMETER_RULES))
    text, value = write(client, "MIS_TOTAL", 5.0, REAL32)
    assert (text.text, text.severity) == ("Param write denied (MIS_TOTAL)", 4)
    assert (value.param_value, copter["MIS_TOTAL"]) == (0.0, 0)


def test_the_store_reads_like_a_dict_and_counts_changes(px4):
    assert (len(px4), px4["COM_OF_LOSS_T"], "NO_SUCH" in px4) == (
        len(parameters_of("px4")),
        1.0,
        False,
    )
    px4.set("COM_OF_LOSS_T", 1.0)
    assert px4.revision == 0
    px4.set("COM_OF_LOSS_T", 2.0)
    px4.set("COM_OF_LOSS_T", 3.0)
    assert px4.revision == 2


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        ({"NOPE": 1.0}, "NOPE"),
        ({"COM_OF_LOSS_T": 99.0}, "allowed are 0 to 60"),
        ({"GF_ACTION": math.nan}, "finite"),
    ],
)
def test_a_bad_override_names_the_parameter_and_what_is_allowed(overrides, said):
    with pytest.raises(ParameterError, match=said):
        ParameterStore(parameters_of("px4"), overrides)


def test_an_override_is_in_place_from_the_start():
    assert ParameterStore(parameters_of("px4"), {"COM_OBL_RC_ACT": 7})["COM_OBL_RC_ACT"] == 7


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_stored_reals_are_single_precision_and_stay_what_they_are(value):
    stored = rounded(ParamKind.REAL32, value)
    assert rounded(ParamKind.REAL32, stored) == stored
    assert struct.unpack("<f", struct.pack("<f", stored))[0] == stored


def test_another_message_is_no_parameter(wire, px4):
    assert wire(ParameterProtocol(px4, PX4_PARAMETER_RULES)).send("PING", 1, 1, 0, 0) == []
