"""Worlds to test against: simulated arms in which effects are hidden. Not installed."""
