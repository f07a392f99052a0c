"""A simulated router: drives, friction, servo loop and node."""
