"""Machine files and where they are found."""
