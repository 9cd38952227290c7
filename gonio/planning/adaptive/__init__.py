"""Adaptive measurement: what is read next depends on what was read, until a target is shown or the time is spent."""
