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

MESSAGES = get_typestore(Stores.EMPTY)
for path in Path(sys.argv[1]).glob("*.msg"):
    definition = path.read_text(encoding="utf-8").replace("char[25]", "uint8[25]")
    MESSAGES.register(get_types_from_msg(definition, f"px4_msgs/msg/{path.stem}"))


def type_of(topic: str) -> str:
    return "px4_msgs/msg/" + topic.title().replace("_", "")


def key(way: str, topic: str) -> str:
    ros_type = type_of(topic).replace("/", "::").replace("msg::", "msg::dds_::")
    return f"0/fmu/{way}/{topic}/{ros_type}_/{MESSAGES.hash_rihs01(type_of(topic))}"


# PX4 pads its payloads, and rosbags' deserialize_cdr refuses what is padded.
def read(topic: str, payload: bytes) -> Any:  # noqa: ANN401
    message = MESSAGES.get_msgdef(type_of(topic))
    return message.deserialize_cdr_le(memoryview(payload)[4:], 0, message.cls, MESSAGES)[0]


def send(topic: str, **fields: object) -> None:  # fields that are not named are 0
    message = read(topic, bytes(1000))
    vars(message).update(fields)
    session.put(key("in", topic), bytes(MESSAGES.serialize_cdr(message, type_of(topic))))


settings = json.dumps({"mode": "router", "listen": {"endpoints": [sys.argv[2]]}})  # PX4 calls it
free = np.full(3, np.nan, np.float32)
with zenoh.open(zenoh.Config.from_json5(settings)) as session:
    topics = ("register_ext_component_reply", "arming_check_request", "vehicle_status")
    inbox = {
        topic: session.declare_subscriber(key("out", topic), zenoh.handlers.FifoChannel(100))
        for topic in topics
    }
    mode = None
    active = False
    while True:
        for topic, subscriber in inbox.items():
            for sample in iter(subscriber.try_recv, None):
                said = read(topic, bytes(sample.payload))
                if topic == "register_ext_component_reply" and said.success:
                    mode = said
                    print(f"mode {mode.mode_id}", flush=True)
                elif topic == "arming_check_request" and mode:  # PX4 waits 50 ms for the answer
                    asked = {"request_id": said.request_id, "registration_id": mode.arming_check_id}
                    send(
                        "arming_check_reply",
                        can_arm_and_run=True,
                        mode_req_local_position=True,
                        **asked,
                    )
                elif topic == "vehicle_status" and not mode:
                    name = np.frombuffer(b"Northward".ljust(25, b"\0"), np.uint8)
                    wish = {
                        "register_arming_check": True,
                        "register_mode": True,
                        "px4_ros2_api_version": 1,
                    }
                    send("register_ext_component_request", request_id=7, name=name, **wish)
                elif topic == "vehicle_status":
                    active = said.nav_state == mode.mode_id
        if mode and active:  # outside its mode a program must be silent
            north = np.array((3.0, 0.0, 0.0), np.float32)
            rest = {"position": free, "acceleration": free, "yaw": np.nan, "yawspeed": np.nan}
            send("trajectory_setpoint", velocity=north, **rest)
        time.sleep(0.02)
