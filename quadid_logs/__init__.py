"""quadid-logs: a multirotor's flight log in, a rotational model with its doubts out."""

__version__ = "0.1.0"
