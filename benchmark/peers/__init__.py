"""feedopt compared with other planners of time-optimal path parametrisation."""
