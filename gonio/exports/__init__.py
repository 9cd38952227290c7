"""What is written for others: any subject in another format, or as the nearest expression of a renderer."""
