"""Write a FlightLog as the autopilot would have."""
