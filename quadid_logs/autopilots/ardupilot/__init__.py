"""ArduPilot: messages, parameters, mixer and filters."""
