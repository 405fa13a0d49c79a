"""What became of a report: taken in, or dropped and why. Every one is counted in the track."""

from enum import StrEnum


class ReportOutcome(StrEnum):
    """The last report's fate. The first five changed the estimate."""

    STARTED = "started"
    ACCEPTED = "accepted"
    REORDERED = "reordered"  # older than the newest one, put in its place in time
    JUMPED = "jumped"  # several outliers in a row agree with each other: the track starts anew there
    REACQUIRED = "reacquired"  # the first one after a long silence
    UNUSABLE = "unusable"  # something in it is no number, or of no size that can be
    IMPLAUSIBLE = "implausible"  # faster than anything that is being pursued
    STALE = "stale"  # too old when it arrived
    FUTURE = "future"  # from after its own arrival
    DUPLICATE = "duplicate"
    TOO_OLD = "too old"  # from before everything that can still be put in order
    OUTLIER = "outlier"


TAKEN = frozenset(
    {
        ReportOutcome.STARTED,
        ReportOutcome.ACCEPTED,
        ReportOutcome.REORDERED,
        ReportOutcome.JUMPED,
        ReportOutcome.REACQUIRED,
    }
)
