"""The pictures of a report: each function takes arrays, and returns one panel as an SVG text."""
