"""The limiters by name, as they appear in records, metrics and the certificate of a cycle."""

from enum import StrEnum


class Limiter(StrEnum):
    """What changed a command, in the order of the page (`guidance.limits.last_word`)."""

    SITUATION = "situation"
    COMMAND = "command"
    CLOCK = "clock"
    SPEED = "speed"
    VERTICAL_SPEED = "vertical speed"
    ACCELERATION = "acceleration"
    VERTICAL_ACCELERATION = "vertical acceleration"
    STAND_OFF = "stand-off"
    FENCE_POLYGON = "fence polygon"
    FENCE_RADIUS = "fence radius"
    FLOOR = "floor"
    CEILING = "ceiling"
    HEIGHT = "height"
    FEED_FORWARD = "feed-forward"
    YAW = "yaw"
