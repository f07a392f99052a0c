"""A simulated router: drives, friction, servo loop, and the node around them."""
