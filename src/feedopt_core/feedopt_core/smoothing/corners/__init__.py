"""Joints between two elements: Euler spirals, blends, and what they replace."""
