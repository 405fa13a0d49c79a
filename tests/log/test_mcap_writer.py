"""The writer of records writes the bytes of the `mcap` package's own writer."""

import io
import sys

from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import Writer

from guidance.log.mcap_writer import McapWriter

TOPICS = ("uav1/mavlink_raw/in", "guidance/cycle", "guidance/event")
MESSAGE = st.tuples(st.sampled_from(TOPICS), st.integers(0, 2**64 - 1), st.binary(max_size=60))
CHUNKS = st.lists(st.lists(MESSAGE, max_size=12), max_size=4)


@given(chunks=CHUNKS)
def test_every_byte_is_that_of_the_package(chunks):
    ours = io.BytesIO()
    theirs = io.BytesIO()
    fast = McapWriter(ours, "guidance")
    package = Writer(theirs, chunk_size=sys.maxsize, use_summary_offsets=False)
    package.start("", "guidance")
    for writer in (fast, package):
        writer.add_metadata("run", {"seed": "1"})
    channels = {}
    sequence = 0
    for chunk in chunks:
        for topic, time_ns, data in chunk:
            if topic not in channels:
                schemas = [
                    writer.register_schema(topic, "jsonschema", b"{}") for writer in (fast, package)
                ]
                assert schemas == [len(channels) + 1] * 2
                channels[topic] = fast.register_channel(topic, "json", schemas[0])
                assert package.register_channel(topic, "json", schemas[0]) == channels[topic]
            fast.add_message(channels[topic], time_ns, data, sequence)
            package.add_message(channels[topic], time_ns, data, time_ns, sequence)
            sequence += 1
        fast.flush()
        package.flush()
        assert ours.getvalue() == theirs.getvalue()
    for writer in (fast, package):
        writer.add_metadata("end", {"last": "yes"})
        writer.finish()
    assert ours.getvalue() == theirs.getvalue()
