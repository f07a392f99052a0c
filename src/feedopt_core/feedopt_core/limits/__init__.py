"""Axis limits along the path."""
