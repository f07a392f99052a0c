"""Starts the graph as processes, executes one program on it, and ends all processes."""
