"""The loop around the model: the controller that flew, replayed, and what it makes of the model."""
