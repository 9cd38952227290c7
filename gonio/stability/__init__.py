"""The stability atlas: every method over its regimes, against a reference that is not the same code."""
