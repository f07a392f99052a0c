"""Independent check of limits, from r(s), s(t) and set points alone."""
