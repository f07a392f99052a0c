"""Plans and runs for other tools: G-code with feeds for existing controllers, set points, trajectories, states."""
