"""Frozen dataclasses that travel between the stages: no I/O, no algorithms."""
