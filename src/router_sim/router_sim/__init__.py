"""A simulated router: drives, friction and servo loop of the axes, and the node that closes the 1 kHz loop of the feedopt motion pipeline."""
