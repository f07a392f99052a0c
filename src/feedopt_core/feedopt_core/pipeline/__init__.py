"""Program in, set points out: reading, planning and surveying a whole program."""
