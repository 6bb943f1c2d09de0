"""Logs that name no autopilot: tables and plain MAVLink."""
