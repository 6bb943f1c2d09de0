"""PX4: topics, parameters, control allocation and filters."""
