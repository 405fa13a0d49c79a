"""Write the golden record again after an intended change of behaviour: `python tests/log/golden.py`.

A flight until it lands, without raw frames and certificates, in one large chunk: small enough to be kept.
"""

import json
import tempfile
from pathlib import Path

from mcap.writer import CompressionType, Writer

from guidance.clock import VirtualClock
from guidance.config import load
from guidance.flight import State
from guidance.log import cycles_of, scan
from guidance.log.entries import CYCLE, EVENT
from guidance.log.writer import Recorder
from guidance.session.fly.daemon import Equipment
from guidance.session.fly.mission import Mission
from guidance.sim.scenario import Scenario
from guidance.sim.stepped import SteppedWorld

DATA = Path(__file__).parents[1] / "data"


def main() -> None:
    scenario = load(Scenario, DATA / "short_chase.toml")
    metadata = {
        "scenario": json.dumps(scenario.model_dump(mode="json")),
        "seed": str(scenario.seed),
    }
    clock = VirtualClock()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "record.mcap"
        world = SteppedWorld(scenario, clock)
        recorder = Recorder(path, metadata)
        try:
            Mission(scenario, world, clock, equipment={"pursuer": Equipment(record=recorder)}).fly()
        finally:
            world.close()
            recorder.close()
        keep(path, DATA / "short_chase.mcap", metadata)


def keep(path: Path, out: Path, metadata: dict[str, str]) -> None:
    """Copy the JSON messages into one chunk."""
    with out.open("wb") as stream:
        writer = Writer(stream, chunk_size=2**24, compression=CompressionType.ZSTD)
        writer.start(profile="", library="guidance")
        writer.add_metadata("run", metadata)
        channels: dict[str, int] = {}
        landing_s = next(row.now_s for row in cycles_of(path) if row.state == State.LANDING)
        replayed = {CYCLE.topic, EVENT.topic}
        items = (
            item for item in scan(path) if item.topic in replayed and item.now_s < landing_s + 1.0
        )
        for number, item in enumerate(items):
            if item.topic not in channels:
                channels[item.topic] = writer.register_channel(item.topic, "json", 0)
            time_ns = round(item.now_s * 1e9)
            writer.add_message(channels[item.topic], time_ns, slim(item.data), time_ns, number)
        writer.finish()
    print(f"{out}: {out.stat().st_size / 1024:.0f} KiB")


def slim(data: bytes) -> bytes:
    """Remove the parts of a row that replay does not compare; the certificate is the longest."""
    row = json.loads(data)
    row |= {name: None for name in ("certificate", "timing") if name in row}
    return json.dumps(row, separators=(",", ":")).encode()


if __name__ == "__main__":
    main()
