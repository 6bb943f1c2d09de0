"""Framing of log files: bytes to rows of messages, without meaning."""
