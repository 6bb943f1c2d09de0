"""What each autopilot logs, mixes and filters: one folder per autopilot."""
