"""The same track in a local frame whose zero lies elsewhere: every place moves alike, and nothing is less sure."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from guidance.estimate.motion import STATES
from guidance.estimate.observer import Observer
from guidance.estimate.track import Accepted, Track
from guidance.frames import Vector


def moved(observer: Observer, into: Callable[[Vector], Vector]) -> Observer:
    """Move everything that is remembered of an evader, as if its reports had been heard in the new frame.

    Args:
        observer: As it was.
        into: From a position in the old frame to the same place in the new one, metres; both point the same way.
    """
    track = observer.track
    if not track.history:
        return observer
    was = track.history[-1].measurement.position_ned_m
    north, east, down = (now - before for before, now in zip(was, into(was), strict=True))
    return observer._replace(track=_moved_track(track, (north, east, down)))


def _moved_track(track: Track, by_ned_m: Vector) -> Track:
    history = tuple(_moved_report(one, by_ned_m) for one in track.history)
    rival = None if track.rival is None else _moved_track(track.rival, by_ned_m)
    return replace(track, history=history, rival=rival)


def _moved_report(one: Accepted, by_ned_m: Vector) -> Accepted:
    measurement, estimate = one
    north, east, down = (here + by for here, by in zip(measurement.position_ned_m, by_ned_m, strict=True))
    shift = np.zeros(STATES)
    shift[:2] = by_ned_m[:2]
    return Accepted(
        measurement._replace(position_ned_m=(north, east, down)),
        estimate._replace(
            modes=estimate.modes._replace(mean=estimate.modes.mean + shift),
            height=estimate.height._replace(down_m=estimate.height.down_m + by_ned_m[2]),
        ),
    )
