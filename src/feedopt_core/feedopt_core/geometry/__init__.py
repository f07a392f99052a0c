"""The path by arc length: segments, NURBS, arc-length maps, the toolpath they form, compiled kernels."""
