"""Pure functions on arrays: numpy and scipy, textbook symbols, no settings, no I/O."""
