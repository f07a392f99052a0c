"""The toolpath node and the planner node."""
