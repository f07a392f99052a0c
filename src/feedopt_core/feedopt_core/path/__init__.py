"""Geometry by arc length: segments, arc-length maps and the toolpath they form."""
