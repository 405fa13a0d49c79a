"""Writes a recorded flight as a ROS 2 bag: MCAP with CDR and ros2msg schemas, and metadata.yaml.

`ros2 bag`, RViz, Foxglove and `rosbags` read it. A team's vehicles are in one bag.
"""

import heapq
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

from guidance.errors import ConfigError
from guidance.files import private_folder, whole_folder, writing
from guidance.links.zenoh import ros_types
from guidance.log.aggregator import SettingsOf
from guidance.log.entries import EventEntry
from guidance.log.export import started_unix_s
from guidance.log.reader import cycles_of, metadata_of, row_of, scan
from guidance.log.ros import RosFlight, nanoseconds_of, ros_name

BAG_VERSION: Final = 8
"""Version of metadata.yaml; ROS 2 Iron and later read it."""

BAG_FOLDER: Final = "ros2"
"""Name of a flight's bag beside its record."""


class _Timed(NamedTuple):
    """A message in CDR, and when it was sent."""

    time_ns: int
    topic: str
    type_name: str
    data: bytes


def write_bag(records: Mapping[str, Path], out: Path, settings_of: SettingsOf) -> str:
    """Write a bag; return the count and unit written, for example "12 messages".

    Args:
        records: The record of every vehicle by its name; the name of a single one may be empty.
        out: The bag's folder, which must not exist.
        settings_of: Makes a flight's settings from a record's metadata.

    Raises:
        ConfigError: If `rosbags` is missing, a record cannot be read or has no cycle, or two names are one in ROS.
        OutputError: If the bag cannot be written.
    """
    ros_types.prepare(f"{out} (a ROS 2 bag)")
    names = dict[str, Path]()
    for name, path in records.items():
        first = next(cycles_of(path), None)
        if first is None:
            raise ConfigError(f"{path}: has no cycle: no bag was written")
        vehicle = "vehicle" if first.vehicle is None else first.vehicle
        names[name if name else vehicle] = path
    if len(set(map(ros_name, names))) < len(names):
        raise ConfigError(f"{', '.join(names)}: two of these names are one in ROS; rename a folder")
    messages = [_messages(name, path, settings_of) for name, path in names.items()]
    with writing(out):
        private_folder(out.parent)
        with whole_folder(out) as unfinished:
            count = _write(heapq.merge(*messages), unfinished)
    return f"{count} messages"


def _messages(name: str, path: Path, settings_of: SettingsOf) -> Iterator[_Timed]:
    """Yield the messages of a record in the order of time."""
    metadata = metadata_of(path)
    started_s = started_unix_s(metadata)
    flight = RosFlight(name, settings_of, metadata, started_s)
    for item in scan(path):
        row = row_of(item, path)
        if row is None:
            continue
        if isinstance(row, EventEntry):
            flight.event(row)
            continue
        time_ns = nanoseconds_of(started_s + row.now_s)
        for topic, content in flight.cycle(row):
            data = ros_types.encode_cdr(content)
            yield _Timed(time_ns, topic, content.__msgtype__, data)


def _write(messages: Iterator[_Timed], folder: Path) -> int:
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer  # noqa: PLC0415 - extra

    count = 0
    connections: dict[str, Any] = {}
    writer = Writer(folder, version=BAG_VERSION, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        for message in messages:
            connection = connections.get(message.topic)
            if connection is None:
                connection = writer.add_connection(
                    message.topic, message.type_name, typestore=ros_types.types()
                )
                connections[message.topic] = connection
            writer.write(connection, message.time_ns, message.data)
            count += 1
    return count
