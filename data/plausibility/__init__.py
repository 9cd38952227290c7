"""What the numbers of a table are suspected of: to contradict their flags, or not to be what they are taken for."""
