"""A wrong value has a residual, and the angles are the paper's. Gradients and residuals: test_gradient_hji.py."""

import numpy as np
import pytest

from guidance.game import Ball, Game
from guidance.game.verification import angles, hji_residual, value_gradient


def test_a_wrong_value_has_a_residual():
    # The evader is faster than the value assumes.
    P = np.array([8.0, 1.42, 9.41])
    E = np.array([7.92, 9.6, 0.0])
    slow = value_gradient(Game(Ball(2.0), 1.0), P, E)
    evading = 1.2 * np.linalg.norm(slow.evader)
    pursuing = 2.0 * np.linalg.norm(slow.pursuer)
    assert 1.0 + evading - pursuing > 0.1
    assert abs(hji_residual(Game(Ball(2.0), 1.0), P, E)) < 1e-8


def test_the_angles_are_those_of_the_papers_formulas():
    P = np.array([6.97, 5.83, 9.15])
    E = np.array([9.80, 0.33, 0.0])
    ratio = 2.0
    hand = ratio * ratio - 1.0
    centre = (ratio * ratio * E - P)[:2] / hand
    radius = np.sqrt(P[2] ** 2 / hand + ratio**2 * np.sum((P - E)[:2] ** 2) / hand**2)
    psi = np.arctan2(centre[1], centre[0])
    meeting = centre - radius * np.array([np.cos(psi), np.sin(psi)])
    found = angles(Game(Ball(ratio), 1.0), P, E, np.zeros(3))
    assert float(found.psi) == pytest.approx(psi, abs=1e-12)
    run = meeting - E[:2]
    way = meeting - P[:2]
    assert float(found.alpha) == pytest.approx(np.arctan2(run[1], run[0]), abs=1e-12)
    assert float(found.beta) == pytest.approx(np.arctan2(way[1], way[0]), abs=1e-12)
    descent = np.arcsin(P[2] / np.hypot(np.hypot(*way), P[2]))
    assert float(found.gamma) == pytest.approx(descent, abs=1e-12)
    assert np.isnan(angles(Game(Ball(ratio), 1.0), P, E).psi)
