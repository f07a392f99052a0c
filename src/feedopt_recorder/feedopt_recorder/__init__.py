"""The recorder: every topic of the graph, raw, into rosbag2-compatible MCAP; and the reading of what it wrote."""
