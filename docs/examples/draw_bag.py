"""Draws the ROS 2 bag of a flight, read with rosbags: no ROS, and nothing of this project.

python docs/examples/draw_bag.py flights/pe-001/ros2 bag.png
"""

import math
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import matplotlib as mpl
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

COLOURS = ("#b3261e", "#0b5fa5", "#2e7d32", "#8e44ad")


class Vehicle:
    """What the bag says of one vehicle: places in `map`, m, and speeds over the flight's time."""

    def __init__(self) -> None:
        self.path: list[tuple[float, float]] = []
        self.evader: list[tuple[float, float]] = []
        self.first: dict[str, list[tuple[float, float]]] = {}
        self.last_rim: list[tuple[float, float]] = []
        self.flown: list[tuple[float, float]] = []
        self.commanded: list[tuple[float, float]] = []

    def take(self, topic: str, now_s: float, message: Any) -> None:  # noqa: ANN401 - of any type
        """Keep what is drawn of a message."""
        if topic == "odometry":
            self.flown.append((now_s, speed(message.twist.twist.linear)))
        elif topic == "setpoint":
            self.commanded.append((now_s, speed(message.twist.linear)))
        elif topic == "path":
            self.path = [(pose.pose.position.x, pose.pose.position.y) for pose in message.poses]
        elif topic == "evader/odometry":
            self.evader.append((message.pose.pose.position.x, message.pose.pose.position.y))
        elif topic == "markers":
            for marker in message.markers:
                name = marker.ns.rpartition("/")[2]
                corners = [(point.x, point.y) for point in marker.points]
                self.first.setdefault(name, corners)
                if name == "standoff":
                    self.last_rim = corners


def speed(velocity: Any) -> float:  # noqa: ANN401 - a Vector3
    """Return the size of a vector."""
    return math.hypot(velocity.x, velocity.y, velocity.z)


def read(bag: Path) -> dict[str, Vehicle]:
    """Read a bag; return its vehicles by name."""
    vehicles: dict[str, Vehicle] = defaultdict(Vehicle)
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        for connection, time_ns, data in reader.messages():
            name, _, topic = connection.topic.strip("/").partition("/")
            if topic:
                now_s = (time_ns - reader.start_time) * 1e-9
                message = reader.deserialize(data, connection.msgtype)
                vehicles[name].take(topic, now_s, message)
    return dict(vehicles)


def draw(vehicles: dict[str, Vehicle], picture: Path) -> None:
    """Draw the plan, and the speeds over time."""
    from matplotlib import pyplot as plt

    figure, (plan, speeds) = plt.subplots(1, 2, figsize=(11.0, 5.4), layout="constrained")
    for colour, (name, vehicle) in zip(COLOURS, vehicles.items(), strict=False):
        plan.plot(*zip(*vehicle.path, strict=True), color=colour, label=f"{name}: path")
        evader = {"color": colour, "linestyle": "--", "label": f"{name}: evader/odometry"}
        plan.plot(*zip(*vehicle.evader, strict=True), **evader)
        for marker, style in (("isochron", ":"), ("standoff", "-.")):
            if marker in vehicle.first:
                line = {"color": colour, "linestyle": style, "linewidth": 1.0}
                label = f"{name}: {marker} at engagement"
                plan.plot(*zip(*vehicle.first[marker], strict=True), **line, label=label)
        if vehicle.last_rim:
            line = {"color": colour, "linewidth": 1.0, "label": f"{name}: standoff, last"}
            plan.plot(*zip(*vehicle.last_rim, strict=True), **line)
        speeds.plot(*zip(*vehicle.flown, strict=True), color=colour, label=f"{name}: odometry")
        if vehicle.commanded:
            line = {"color": colour, "linestyle": ":", "label": f"{name}: setpoint"}
            speeds.plot(*zip(*vehicle.commanded, strict=True), **line)
    plan.set(title="map, from above", xlabel="x east, m", ylabel="y north, m", aspect="equal")
    speeds.set(title="Speed", xlabel="time in the bag, s", ylabel="m/s")
    for axes in (plan, speeds):
        axes.grid(alpha=0.3)
    handles, labels = plan.get_legend_handles_labels()
    columns = min(3, len(vehicles))
    figure.legend(handles, labels, loc="outside lower left", ncols=columns, fontsize=8)
    speeds.legend(fontsize=8)
    figure.savefig(picture, dpi=110)
    plt.close(figure)


def main(bag: str = "ros2", picture: str = "bag.png") -> None:
    """Draw one bag."""
    mpl.use("agg")
    draw(read(Path(bag)), Path(picture))
    print(picture)


if __name__ == "__main__":
    main(*sys.argv[1:])
