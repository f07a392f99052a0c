"""The rclpy code that all nodes use."""
