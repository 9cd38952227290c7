"""Speed against accuracy, measured here and now: one module a chart."""
