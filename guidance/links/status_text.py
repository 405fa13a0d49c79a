"""STATUSTEXT longer than 50 bytes comes in chunks; this joins them."""

from typing import NamedTuple

from guidance.links.codec import Fields
from guidance.messages import StatusText

CHUNK_BYTES = 50
PATIENCE_S = 1.0
MOST_CHUNKS = 16


class OpenText(NamedTuple):
    """A text whose last chunk has not come yet."""

    first_received_s: float
    message_id: int
    severity: int
    chunks: tuple[str, ...]
    next_sequence: int

    def close(self) -> StatusText:
        """Take the text as it stands."""
        return StatusText(self.first_received_s, self.severity, "".join(self.chunks))


def join(open_text: OpenText | None, fields: Fields, received_s: float) -> tuple[OpenText | None, list[StatusText]]:
    """Add one STATUSTEXT: what is open afterwards, and which texts are complete.

    `id` 0 is a text of one chunk. A chunk that is not full is the last one. A gap is shown as an ellipsis.
    """
    done: list[StatusText] = []
    message_id, sequence, text = fields.get("id", 0), fields.get("chunk_seq", 0), fields["text"]
    continues = open_text is not None and message_id == open_text.message_id != 0
    if open_text is not None and not continues:
        done.append(open_text.close())
        open_text = None
    if message_id == 0:
        return None, [*done, StatusText(received_s, fields["severity"], text)]
    if open_text is None:
        open_text = OpenText(received_s, message_id, fields["severity"], (), 0)
    gap = ("…",) if sequence != open_text.next_sequence else ()
    open_text = open_text._replace(chunks=(*open_text.chunks, *gap, text), next_sequence=sequence + 1)
    if len(text.encode()) < CHUNK_BYTES or len(open_text.chunks) >= MOST_CHUNKS:
        return None, [*done, open_text.close()]
    return open_text, done


def expire(open_text: OpenText | None, now_s: float) -> tuple[OpenText | None, list[StatusText]]:
    """Give up waiting for the rest after a second."""
    if open_text is not None and now_s - open_text.first_received_s > PATIENCE_S:
        return None, [open_text.close()]
    return open_text, []
