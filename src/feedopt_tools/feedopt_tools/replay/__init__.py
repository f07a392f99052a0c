"""Replay regression: every stage fed its recorded inputs again, every output message compared with the recorded one."""
