import numpy as np
import pytest

from guidance.game import Ball, Game, solve

PAPER = Game(Ball(2.0), 1.0)
P_PE, E_PE = np.array([8.0, 1.42, 9.41]), np.array([7.92, 9.6, 0.0])


def test_optimal_play_of_the_papers_pe_case_takes_its_equation_10():
    d, z, delta = float(np.hypot(0.08, 8.18)), 9.41, 2.0
    expected = (d + np.sqrt((delta**2 - 1) * z**2 + delta**2 * d**2)) / (delta**2 - 1)
    assert solve(PAPER, P_PE, E_PE).value == pytest.approx(expected, rel=1e-14)
