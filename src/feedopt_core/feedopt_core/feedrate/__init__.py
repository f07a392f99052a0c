"""Planning the feed profile q(s) = feedrate squared."""
