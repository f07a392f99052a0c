"""feedopt beside other planners of time-optimal path parametrisation."""
