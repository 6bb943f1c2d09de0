"""From aligned flight data to models with intervals."""
