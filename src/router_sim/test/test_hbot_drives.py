"""The H-bot's drives: axis positions are mm of belt, and the tool is where both belts put it."""

from __future__ import annotations

import numpy as np
from reference_moves import Move, circle

from feedopt_core.machine.machine_file import load_machine
from router_sim.machine_file import load_router_parameters
from router_sim.router import SimulatedRouter

RADIUS_MM = 45.0
RATE_RAD_S = 12.0


def belts(tool: Move) -> Move:
    """The same move of the belts: q1 = x + y, q2 = x - y."""
    matrix = np.array([[1.0, 1.0], [1.0, -1.0]])
    rows = (tool.position_mm, tool.velocity_mm_s, tool.acceleration_mm_s2, tool.jerk_mm_s3)
    return Move(*(values @ matrix.T for values in rows))


def test_belts_follow_a_circle_near_their_limits() -> None:
    machine, parameters = load_machine("hbot"), load_router_parameters("hbot")
    tool = circle(RADIUS_MM, RATE_RAD_S)
    move = belts(tool)
    # The circle asks the belts for sqrt 2 of what it asks the tool for, and for nearly all they may.
    peak = float(np.max(np.abs(move.acceleration_mm_s2)))
    assert 0.9 * machine.acceleration_limit_mm_s2[0] < peak < machine.acceleration_limit_mm_s2[0]
    assert peak > 1.3 * RADIUS_MM * RATE_RAD_S**2
    states = move.run(SimulatedRouter(parameters))
    assert not any(any(state.saturated) for state in states)
    followed_mm = np.array([state.position_mm for state in states]) @ machine.tool_matrix().T
    # Counts of 8.6 um on each belt, and 19 um of error law at the largest acceleration.
    assert float(np.max(np.linalg.norm(followed_mm - tool.position_mm, axis=1))) < 0.05
