"""Logs from the vehicle: over MAVLink (serial, UDP, TCP), or from a mounted card or mass storage."""
