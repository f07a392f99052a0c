"""Every algorithm of the feedopt motion pipeline, free of ROS: toolpath parsing, smoothing, geometry by arc length, limits, feed-rate planning, interpolation and audit."""
