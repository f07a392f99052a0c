"""Every algorithm of the feedopt motion pipeline, free of ROS."""
