"""Exports plans and runs: G-code with feeds for existing controllers, set points, trajectories, states."""
