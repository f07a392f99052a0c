"""Recording every topic of the graph, raw, into rosbag2-compatible MCAP."""
