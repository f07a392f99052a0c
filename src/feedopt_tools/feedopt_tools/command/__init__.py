"""The ``feedopt`` command: one file per sub-command, imported when the sub-command is used."""
