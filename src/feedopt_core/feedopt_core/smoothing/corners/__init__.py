"""Joints between two sides: Euler spirals, blends, and what they replace."""
