"""Read flight logs, by content: the only place that knows the vendors' names."""
