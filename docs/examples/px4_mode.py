"""A flight mode of PX4 over Zenoh that flies north at 3 m/s; it needs eclipse-zenoh, rosbags, and PX4's messages.

git clone -b release/1.17 https://github.com/PX4/px4_msgs && python px4_mode.py px4_msgs/msg tcp/127.0.0.1:7447
"""

import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import zenoh
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

NAME = np.frombuffer(b"Northward".ljust(25, b"\0"), np.uint8)
NORTH = np.array((3.0, 0.0, 0.0), np.float32)
FREE = np.full(3, np.nan, np.float32)
last: dict[str, Any] = {}  # what PX4 said, by topic
types = get_typestore(Stores.EMPTY)
for path in Path(sys.argv[1]).glob("*.msg"):
    definition = path.read_text(encoding="utf-8").replace("char[25]", "uint8[25]")
    types.register(get_types_from_msg(definition, f"px4_msgs/msg/{path.stem}"))


def type_of(topic: str) -> str:
    return "px4_msgs/msg/" + topic.title().replace("_", "")


def key(way: str, topic: str) -> str:
    kind = type_of(topic).replace("/", "::").replace("msg::", "msg::dds_::")
    return f"0/fmu/{way}/{topic}/{kind}_/{types.hash_rihs01(type_of(topic))}"


def read(topic: str, body: bytes) -> Any:  # noqa: ANN401
    kind = types.get_msgdef(type_of(topic))
    # types.deserialize_cdr would refuse PX4's payloads, because they are padded
    return kind.deserialize_cdr_le(memoryview(body), 0, kind.cls, types)[0]


def send(topic: str, **fields: object) -> None:
    message = read(topic, bytes(1000))  # all 0
    vars(message).update(fields)
    payload = bytes(types.serialize_cdr(message, type_of(topic)))
    session.put(key("in", topic), payload, congestion_control=zenoh.CongestionControl.BLOCK)


def hear(sample: zenoh.Sample) -> None:
    topic = str(sample.key_expr).split("/")[3]
    said = last[topic] = read(topic, sample.payload.to_bytes()[4:])
    mode = last.get("register_ext_component_reply")
    if topic == "vehicle_status" and not mode and time.monotonic() > last.get("asked_s", 0.0) + 1.0:
        last["asked_s"] = time.monotonic()  # two requests would register two modes
        wish = {"register_mode": True, "register_arming_check": True, "px4_ros2_api_version": 1}
        send("register_ext_component_request", name=NAME, **wish)
    elif topic == "arming_check_request" and mode:  # PX4 waits 50 ms for the answer
        numbers = {"request_id": said.request_id, "registration_id": mode.arming_check_id}
        send("arming_check_reply", **numbers, can_arm_and_run=True, mode_req_local_position=True)


router = json.dumps({"mode": "router", "listen": {"endpoints": [sys.argv[2]]}})  # PX4 calls it
heard = ("vehicle_status", "register_ext_component_reply", "arming_check_request")
with zenoh.open(zenoh.Config.from_json5(router)) as session:
    subscribers = [session.declare_subscriber(key("out", topic), hear) for topic in heard]
    while not (mode := last.get("register_ext_component_reply")):
        time.sleep(0.02)
    print(f"mode {mode.mode_id}" if mode.success else sys.exit("PX4 refused the mode"), flush=True)
    while True:
        if last["vehicle_status"].nav_state == mode.mode_id:  # elsewhere a program must be silent
            rest = {"position": FREE, "acceleration": FREE, "yaw": np.nan, "yawspeed": np.nan}
            send("trajectory_setpoint", velocity=NORTH, **rest)
        time.sleep(0.02)
