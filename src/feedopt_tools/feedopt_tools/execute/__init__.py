"""Starting the graph as processes, executing one program on it, and ending all of it."""
