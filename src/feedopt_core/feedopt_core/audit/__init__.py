"""Independent check of all limits, computed from r(s), s(t) and the set points only."""
