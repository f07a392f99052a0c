"""Motion along the path in time: feed profile, chunk, certificate, set points."""
