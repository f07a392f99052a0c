"""The rclpy shell that the nodes share."""
