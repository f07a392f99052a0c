"""What the views show, as arrays: signals, limits in use, contour error, events."""
