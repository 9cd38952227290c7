"""Where methods fail: second opinions on every model, and what they show."""
