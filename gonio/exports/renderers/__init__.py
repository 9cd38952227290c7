"""One renderer each: its surface as it computes it, and the file that states it."""
