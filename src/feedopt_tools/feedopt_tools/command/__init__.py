"""The ``feedopt`` command: one file a sub-command, imported when it is used."""
