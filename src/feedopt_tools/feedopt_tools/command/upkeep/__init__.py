"""Commands that check the workspace and the computer."""
