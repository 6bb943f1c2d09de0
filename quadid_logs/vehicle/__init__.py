"""Frame geometry and thrust curves: from logged outputs to L, M, N."""
